"""The page that says why the pods of an app are where they are: pods by the API server, decisions by the scheduler, both with the caller's rights."""

from aiohttp import web

from robotapp_api.model.names import Label
from robotapp_client import ClientError, Listing, NotFound, Unauthorized
from robotapp_client.api.resources import PODS, ROBOTAPPS
from robotapp_console.views.app.reasons import build_reasons, find_trouble, list_without_pods, select_pods
from robotapp_console.views.objects import AppPod
from robotapp_console.views.problems import path_of_app
from robotapp_console.views.texts import clean, kubectl
from robotapp_console.web.app_actions import read_app
from robotapp_console.web.console import CALLER, CONSOLE
from robotapp_console.web.signing import answer_expired


async def show_reasons(request: web.Request) -> web.StreamResponse:
    """Answers `/apps/NAMESPACE/NAME/why`; `robot` names the instance, by default the first one that has pods."""
    console, caller = request.app[CONSOLE], request[CALLER]
    namespace, name = read_app(request)
    robot = request.query.get("robot")
    back = {"Back to the app": path_of_app(namespace, name, robot or "")}
    informers = await console.informers.get(caller.key, caller.endpoint)
    try:
        app = await informers.client.get(ROBOTAPPS, name, namespace=namespace)
        selector = f"{Label.APP_UID}={app['metadata']['uid']}"
        listing: Listing[AppPod] = await informers.client.list(
            PODS, namespace=namespace, label_selector=selector, as_type=AppPod
        )
    except Unauthorized:
        return answer_expired(request)
    except NotFound:
        return console.answer_message(request, 404, "Not found", f"There is no RobotApp {namespace}/{name}.")
    except ClientError as error:
        return console.answer_message(request, 403, "Not shown: pods of the app", clean(str(error)), links=back)
    if robot is None:
        robot = min((pod.metadata.labels.get(Label.INSTANCE, "") for pod in listing.items), default="")
    pods = select_pods(listing.items, robot)
    records, problem = await console.scheduler.explain(caller.endpoint, namespace, [pod.metadata.name for pod in pods])
    on_robot = ("--robot", robot) if robot else ()
    context = {
        "title": clean(f"Why here? {namespace}/{name}" + (f" on {robot}" if robot else ""), 320),
        "rows": build_reasons(app, pods, records, robot=robot),
        "without_pods": list_without_pods(app, pods),
        "problem": problem,
        "trouble": find_trouble(app, robot),
        "path": path_of_app(namespace, name, robot),
        "namespace_of_app": namespace,
        "name": name,
        "robot": clean(robot, 63),
        "command": kubectl("robotapp", "explain", name, "-n", namespace, *on_robot),
    }
    return web.Response(text=console.render(request, "app_why.html", context), content_type="text/html")
