"""What can be done from the page of an app: by whom, with what result, and what is refused."""

import re
from html import unescape

import pytest
from tests.unit.console.guarded_api import ADMIN, APPS, INSTANCES, TENANT, VIEWER, Browser, Page, Stage, staged
from tests.unit.console.objects import Object, app, instance

from robotapp_api.values.approval import describe_approval
from robotapp_api.values.naming import child_name
from robotapp_client.api.resources import ROBOTAPPS
from robotapp_console.cluster.rights import Right
from robotapp_console.web import actions

DEPLOYMENTS = "apps/deployments"
PAGE = "/apps/team-a/teleop"


def fill(stage: Stage) -> str:
    """Puts an app with one component into namespace team-a and returns its uid."""
    body = stage.api.put(APPS, app("teleop", namespace="team-a", uid="u-1"))
    uid = str(body["metadata"]["uid"])
    component = {"name": "driver", "node": "amr-07", "ready": True}
    single = instance("teleop", "amr-07", namespace="team-a", app_uid=uid, components=[component])
    stage.api.put(INSTANCES, single)
    name = child_name("teleop", "amr-07", "driver")
    labels = {"robotics.io/app-uid": uid}
    stage.api.put(DEPLOYMENTS, {"metadata": {"name": name, "namespace": "team-a", "labels": labels}, "spec": {}})
    return uid


def read(stage: Stage, collection: str, name: str) -> Object:
    return next(obj for key, obj in stage.api.store.objects.items() if (key.collection, key.name) == (collection, name))


async def sign_in(stage: Stage, token: str) -> Browser:
    browser = stage.browser()
    assert (await browser.sign_in(token, home="team-a")).status == 303
    return browser


async def press(browser: Browser, action: str, *, page: Page, **fields: str) -> Page:
    """Presses the page's button for this action, or posts its form, with what the page holds."""
    button = re.search(rf'<button form="actions" formaction="({PAGE}/{action}[^"]*)"', page.text)
    if button is not None:
        return await browser.post(unescape(button[1]), {"csrf": page.field("csrf")} | fields)
    form = re.search(rf'<form method="post" action="{PAGE}/{action}".*?</form>', page.text, re.DOTALL)
    assert form is not None, f"no button for {action}"
    held = {name: unescape(value) for name, value in re.findall(r'name="(\w+)" value="([^"]*)"', form[0])}
    return await browser.post(f"{PAGE}/{action}", held | fields)


async def test_a_tenant_suspends_and_resumes_its_app_and_is_told_so() -> None:
    async with staged() as stage:
        fill(stage)
        browser = await sign_in(stage, TENANT)
        answer = await press(browser, "suspend", page=await browser.get(PAGE))
        assert answer.status == 303
        assert read(stage, APPS, "teleop")["spec"]["suspend"] is True
        page = await browser.get(answer.headers["Location"])
        assert "team-a/teleop is suspended" in page.text
        assert "notice=" not in page.text, "neither the stream nor a link repeats it"
        assert (await press(browser, "resume", page=page)).status == 303
        assert read(stage, APPS, "teleop")["spec"]["suspend"] is False


async def test_a_restart_is_that_of_kubectl_rollout() -> None:
    async with staged() as stage:
        fill(stage)
        browser = await sign_in(stage, TENANT)
        answer = await press(browser, "restart", page=await browser.get(PAGE))
        assert answer.status == 303
        deployment = read(stage, DEPLOYMENTS, child_name("teleop", "amr-07", "driver"))
        assert "kubectl.kubernetes.io/restartedAt" in deployment["spec"]["template"]["metadata"]["annotations"]
        assert "driver on amr-07 restarts" in (await browser.get(answer.headers["Location"])).text


async def test_a_component_that_has_not_started_is_not_restarted_and_the_page_says_so() -> None:
    async with staged() as stage:
        uid = fill(stage)
        browser = await sign_in(stage, TENANT)
        fields = {"uid": uid, "component": "mapper", "robot_of_component": "amr-07"}
        answer = await browser.post(f"{PAGE}/restart", fields | {"csrf": (await browser.get(PAGE)).field("csrf")})
        assert answer.status == 404
        assert "mapper has not started, so there is nothing to restart." in answer.text


async def test_a_deployment_of_the_name_that_is_not_the_apps_is_left_alone() -> None:
    async with staged() as stage:
        uid = fill(stage)
        name = child_name("teleop", "amr-07", "driver")
        stage.api.put(DEPLOYMENTS, {"metadata": {"name": name, "namespace": "team-a", "labels": {}}, "spec": {}})
        browser = await sign_in(stage, TENANT)
        fields = {"uid": uid, "component": "driver", "robot_of_component": "amr-07"}
        answer = await browser.post(f"{PAGE}/restart", fields | {"csrf": (await browser.get(PAGE)).field("csrf")})
        assert answer.status == 404
        assert "does not belong to the app" in answer.text
        assert read(stage, DEPLOYMENTS, name)["spec"] == {}


async def test_templates_that_wait_are_approved_with_the_version_that_the_operator_names() -> None:
    async with staged() as stage:
        fill(stage)
        body = app("teleop", namespace="team-a")
        message = f"2 templates of a newer operator wait; annotate {describe_approval('0.2.0')} to roll them"
        body["status"]["conditions"] = [{"type": "Progressing", "status": "False", "message": message}]
        stage.api.put(APPS, body)
        browser = await sign_in(stage, TENANT)
        answer = await press(browser, "approve", page=await browser.get(PAGE))
        assert answer.status == 303
        assert read(stage, APPS, "teleop")["metadata"]["annotations"] == {"robotics.io/approve-update": "0.2.0"}


async def test_deleting_takes_the_typed_name() -> None:
    async with staged() as stage:
        fill(stage)
        browser = await sign_in(stage, TENANT)
        form = await browser.get(f"{PAGE}/delete")
        wrong = await press(browser, "delete", page=form, typed="teleop-2")
        assert wrong.status == 422
        assert "not teleop" in wrong.text
        assert read(stage, APPS, "teleop")
        answer = await press(browser, "delete", page=form, typed="teleop")
        assert answer.status == 303
        assert not [key for key in stage.api.store.objects if key.collection == APPS]
        assert "team-a/teleop is deleted" in (await browser.get(answer.headers["Location"])).text


async def test_another_app_of_the_name_is_not_deleted() -> None:
    async with staged() as stage:
        fill(stage)
        browser = await sign_in(stage, TENANT)
        form = await browser.get(f"{PAGE}/delete")
        stage.api.remove(APPS, "teleop", "team-a")
        stage.api.put(APPS, app("teleop", namespace="team-a", uid="u-2"))
        answer = await press(browser, "delete", page=form, typed="teleop")
        assert answer.status == 409
        assert "made anew" in answer.text
        assert read(stage, APPS, "teleop")


@pytest.mark.parametrize("action", ["suspend", "resume", "restart", "approve", "delete"])
async def test_a_viewer_sees_no_button_and_a_forged_form_is_403(action: str) -> None:
    async with staged() as stage:
        uid = fill(stage)
        browser = await sign_in(stage, VIEWER)
        page = await browser.get(PAGE)
        assert page.status == 200
        assert f"/{action}" not in page.text
        fields = {"uid": uid, "component": "driver", "robot_of_component": "amr-07", "typed": "teleop", "version": "9"}
        forged = await browser.post(f"{PAGE}/{action}", fields | {"csrf": page.field("csrf")})
        assert forged.status == 403
        assert "You may not" in forged.text
        assert (await browser.get(f"{PAGE}/delete")).status == 403
        assert not any(method in ("PATCH", "DELETE") for method, _ in stage.api.requests)


async def test_a_form_without_the_csrf_token_or_of_another_site_changes_nothing() -> None:
    async with staged() as stage:
        uid = fill(stage)
        browser = await sign_in(stage, ADMIN)
        csrf = (await browser.get(PAGE)).field("csrf")
        assert (await browser.post(f"{PAGE}/suspend", {"uid": uid})).status == 403
        assert (await browser.post(f"{PAGE}/suspend", {"uid": uid, "csrf": csrf}, Origin="https://evil")).status == 403
        assert (await browser.get(f"{PAGE}/suspend")).status in (404, 405)
        assert "suspend" not in read(stage, APPS, "teleop")["spec"]


async def test_a_form_without_a_uid_or_with_a_name_that_would_be_a_path_is_refused() -> None:
    async with staged() as stage:
        uid = fill(stage)
        browser = await sign_in(stage, ADMIN)
        csrf = (await browser.get(PAGE)).field("csrf")
        assert (await browser.post(f"{PAGE}/suspend", {"csrf": csrf})).status == 422
        for name in ("teleop%2Fstatus", "..", "teleop%3FdryRun=All"):
            answer = await browser.post(f"/apps/team-a/{name}/suspend", {"csrf": csrf, "uid": uid})
            assert answer.status in (400, 404, 405), name
        assert not any(method == "PATCH" for method, _ in stage.api.requests)


async def test_nobody_but_the_console_makes_a_page_say_that_something_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    async with staged() as stage:
        fill(stage)
        browser, other = await sign_in(stage, TENANT), await sign_in(stage, ADMIN)
        address = (await press(browser, "suspend", page=await browser.get(PAGE))).headers["Location"]
        assert 'class="notice"' in (await browser.get(address)).text
        assert 'class="notice"' not in (await other.get(address)).text
        assert 'class="notice"' not in (await browser.get(address.replace("is+suspended", "is+deleted"))).text
        assert 'class="notice"' not in (await browser.get(address.replace(PAGE, "/"))).text
        later = actions.time.time() + actions.NOTICE_S + 1
        monkeypatch.setattr(actions.time, "time", lambda: later)
        assert 'class="notice"' not in (await browser.get(address)).text


async def test_rights_are_asked_for_once_and_the_words_name_them() -> None:
    async with staged() as stage:
        fill(stage)
        browser = await sign_in(stage, TENANT)
        for _ in range(3):
            await browser.get(PAGE)
        reviews = [path for _, path in stage.api.requests if "selfsubjectaccessreviews" in path]
        assert len(reviews) <= 3
    assert Right("patch", ROBOTAPPS, "a", "b").words == "patch robotapps.robotics.io b in namespace a"
