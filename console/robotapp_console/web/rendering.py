"""Templates and static files, read once at the start."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import jinja2
from aiohttp import web

from robotapp_console.views.texts import Moment, clean, describe_moment, format_cpu, format_memory

ROOT: Final = Path(__file__).resolve().parent.parent
_TYPES: Final = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml", "": "text/plain"}
_DAY_S: Final = 86_400


class StaticFiles:
    """Files that hold no data: the only ones that browsers may keep. Their addresses carry a hash of the content."""

    def __init__(self, folder: Path = ROOT / "static") -> None:
        self._files = {
            path.relative_to(folder).as_posix(): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
        self._hashes = {name: hashlib.sha256(content).hexdigest()[:16] for name, content in self._files.items()}

    def __repr__(self) -> str:
        return f"<StaticFiles {len(self._files)}>"

    def address(self, name: str) -> str:
        return f"/static/{name}?v={self._hashes[name]}"

    async def serve(self, request: web.Request) -> web.Response:
        name = request.match_info["name"]
        content = self._files.get(name)
        if content is None:
            raise web.HTTPNotFound
        headers = {"Cache-Control": f"public, max-age={_DAY_S}", "ETag": f'"{self._hashes[name]}"'}
        if request.headers.get("If-None-Match") == headers["ETag"]:
            return web.Response(status=304, headers=headers)
        return web.Response(body=content, content_type=_TYPES[Path(name).suffix], charset="utf-8", headers=headers)


class Pages:
    """Renders templates. Whatever is inserted is text: escaping is on for every template, and nothing is ever marked as safe."""

    def __init__(self, files: StaticFiles) -> None:
        self._templates = jinja2.Environment(
            loader=jinja2.FileSystemLoader(ROOT / "templates"),
            autoescape=True,
            undefined=jinja2.StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
            auto_reload=False,
        )
        self._templates.globals |= {"static": files.address, "cpu": format_cpu, "memory": format_memory, "clean": clean}

    def __repr__(self) -> str:
        return "<Pages>"

    def render(self, template: str, context: Mapping[str, Any], *, now_s: float = 0.0) -> str:
        """Returns the HTML of a template. Relative times are counted up to `now_s`."""

        def moment(timestamp: str) -> Moment | None:
            return describe_moment(timestamp, now_s)

        return self._templates.get_template(template).render(context, moment=moment)
