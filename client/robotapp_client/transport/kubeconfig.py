"""The address of the API server and our identity: kubeconfig files and the pod's service account.

Our own 150 lines instead of the official client: that costs 0.5 s and 60 MB at import, and exec plug-ins (which also
bring OIDC, by kubelogin) need none of it.
"""

import base64
import binascii
import os
import ssl
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from robotapp_client.transport.credentials import Credentials, ExecPlugin, file_source, load_pair
from robotapp_client.transport.errors import LoginError
from robotapp_client.transport.proxy import Proxy, find_proxy
from robotapp_client.transport.tls_files import TlsFiles
from robotapp_client.transport.tls_sessions import with_resumption

SERVICE_ACCOUNT = Path("/var/run/secrets/kubernetes.io/serviceaccount")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One API server and one identity; `server` has no trailing slash, `security` is None for plain HTTP (test doubles)."""

    server: str
    security: ssl.SSLContext | TlsFiles | None = None
    credentials: Credentials = field(default_factory=Credentials)
    namespace: str = "default"
    server_hostname: str | None = None
    proxy: Proxy | None = None
    """Through which every connection to the server goes."""

    def __repr__(self) -> str:
        return f"<Endpoint {self.server}, namespace {self.namespace}>"

    @property
    def tls(self) -> ssl.SSLContext | None:
        """The context for the next connection: files are followed, so it may be another one each time."""
        return self.security.context if isinstance(self.security, TlsFiles) else self.security


def default_kubeconfigs(environ: Mapping[str, str] = os.environ) -> list[Path]:
    """What kubectl would read: $KUBECONFIG (several files allowed), else ~/.kube/config; only files that exist.

    For tools a person starts. The operator and the scheduler never guess: they take a flag or the service account.
    """
    listed = [Path(name) for name in environ.get("KUBECONFIG", "").split(os.pathsep) if name]
    candidates = listed or [Path(environ.get("HOME", "~")).expanduser() / ".kube" / "config"]
    return [path for path in candidates if path.is_file()]


def load(
    kubeconfig: Path | Sequence[Path] | None = None,
    context: str | None = None,
    *,
    service_account: Path = SERVICE_ACCOUNT,
    environ: Mapping[str, str] = os.environ,
) -> Endpoint:
    """Endpoint of a kubeconfig (`context` or its current one), or of the pod we run in when there is no kubeconfig."""
    if kubeconfig:
        files = [kubeconfig] if isinstance(kubeconfig, Path) else list(kubeconfig)
        return _from_kubeconfig(files, context, environ)
    if (service_account / "token").is_file() and environ.get("KUBERNETES_SERVICE_HOST"):
        return _in_cluster(service_account, environ)
    named = environ.get("KUBECONFIG")
    lost = f"; $KUBECONFIG names {named}, where no file is" if named and not default_kubeconfigs(environ) else ""
    raise LoginError(f"no API server: not running in a pod, and no kubeconfig was given (use --kubeconfig FILE){lost}")


def _in_cluster(folder: Path, environ: Mapping[str, str]) -> Endpoint:
    host, port = environ["KUBERNETES_SERVICE_HOST"], environ.get("KUBERNETES_SERVICE_PORT", "443")
    host = f"[{host}]" if ":" in host else host
    namespace = folder / "namespace"
    server = f"https://{host}:{port}"
    return Endpoint(
        server=server,
        security=follow_authority(folder / "ca.crt"),
        credentials=Credentials(file_source(folder / "token")),
        namespace=namespace.read_text().strip() if namespace.is_file() else "default",
        proxy=find_proxy(server, environ),
    )


def follow_authority(path: Path) -> TlsFiles:
    """Returns the trust in the authorities of a file, which may be replaced. Raises LoginError."""

    def make() -> ssl.SSLContext:
        try:
            return with_resumption(_trusting(cafile=str(path)))
        except (OSError, ssl.SSLError) as error:
            raise LoginError(f"the API server's certificate authority {path} cannot be loaded: {error}") from error

    return TlsFiles([path], make)


def _from_kubeconfig(files: Sequence[Path], context: str | None, environ: Mapping[str, str]) -> Endpoint:
    """Returns the endpoint of these files, whose authorities, certificates and token are followed when files change."""
    chosen, cluster, user, where = _choose(files, context)
    server = str(cluster.get("server", "")).rstrip("/")
    if not server.startswith(("https://", "http://")):
        raise LoginError(f"{where}: the cluster's server {server!r} is no http(s) URL")
    proxy = find_proxy(server, environ, proxy_url=str(cluster.get("proxy-url") or ""), where=where)
    for key in ("auth-provider", "username", "as"):
        if user.get(key):
            cure = "use an exec plug-in (for OIDC: kubelogin)" if key == "auth-provider" else "remove it"
            raise LoginError(f"{where}: the user's {key!r} is not supported; {cure}")
    security: ssl.SSLContext | TlsFiles | None = None
    if server.startswith("https://") and user.get("exec"):
        security = _tls(cluster)  # the plug-in may load its certificate into it
    elif server.startswith("https://"):
        security = TlsFiles(_paths_of(files, cluster, user), lambda: _make_tls(files, context))
    return Endpoint(
        server=server,
        security=security,
        credentials=_credentials(
            user,
            cluster,
            security if isinstance(security, ssl.SSLContext) else None,
            read_again=lambda: _choose(files, context)[2],
        ),
        namespace=str(chosen.get("namespace") or "default"),
        server_hostname=cluster.get("tls-server-name") or None,
        proxy=proxy,
    )


def _paths_of(files: Sequence[Path], cluster: Mapping[str, Any], user: Mapping[str, Any]) -> list[Path]:
    """Returns all files that decide whom we trust and who we are by certificate."""
    names = (cluster.get("certificate-authority"), user.get("client-certificate"), user.get("client-key"))
    return [*files, *(Path(name) for name in names if name)]


def _make_tls(files: Sequence[Path], context: str | None) -> ssl.SSLContext:
    """Reads the files anew. Raises LoginError."""
    _, cluster, user, _ = _choose(files, context)
    tls = _tls(cluster)
    return tls if _client_certificate(tls, user) else with_resumption(tls)


def _choose(files: Sequence[Path], context: str | None) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any], str]:
    """Returns context, cluster and user, and the files' names for messages. Raises LoginError."""
    config = _merge([_read(path) for path in files])
    where = ", ".join(map(str, files))
    name = context or config.current
    if not name:
        raise LoginError(f"{where} has no current-context; name one of: {', '.join(config.contexts) or 'none defined'}")
    chosen = _named(config.contexts, name, "context", where)
    cluster = _named(config.clusters, str(chosen.get("cluster", "")), "cluster", where)
    user = _named(config.users, str(chosen["user"]), "user", where) if chosen.get("user") else {}
    return chosen, cluster, user, where


@dataclass(slots=True)
class _Config:
    contexts: dict[str, dict[str, Any]] = field(default_factory=dict)
    clusters: dict[str, dict[str, Any]] = field(default_factory=dict)
    users: dict[str, dict[str, Any]] = field(default_factory=dict)
    current: str = ""


def _read(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            config = yaml.load(file, yaml.CSafeLoader)
    except OSError as error:
        raise LoginError(f"cannot read the kubeconfig {path}: {error.strerror}") from error
    except yaml.YAMLError as error:
        raise LoginError(f"the kubeconfig {path} is not YAML: {error}") from error
    if not isinstance(config, dict):
        raise LoginError(f"the kubeconfig {path} holds no mapping")
    # Files named in a kubeconfig are relative to it, and after merging it is unknown which one that was.
    for section, keys in (("clusters", ("certificate-authority",)), ("users", _USER_FILES)):
        for entry in config.get(section) or []:
            body = entry.get(section[:-1]) or {}
            for key in keys:
                if body.get(key):
                    body[key] = str(path.parent.absolute() / body[key])
            command = (body.get("exec") or {}).get("command", "")
            if "/" in command:
                body["exec"]["command"] = str(path.parent.absolute() / command)
    return config


_USER_FILES = ("client-certificate", "client-key", "tokenFile")


def _merge(configs: Sequence[dict[str, Any]]) -> _Config:
    merged = _Config()
    for config in configs:  # the first file wins, as for kubectl
        merged.current = merged.current or config.get("current-context") or ""
        for section, target in (
            ("contexts", merged.contexts),
            ("clusters", merged.clusters),
            ("users", merged.users),
        ):
            for entry in config.get(section) or []:
                target.setdefault(entry.get("name", ""), entry.get(section[:-1]) or {})
    return merged


def _named(section: Mapping[str, dict[str, Any]], name: str, kind: str, where: str) -> dict[str, Any]:
    try:
        return section[name]
    except KeyError:
        known = ", ".join(sorted(section)) or "none"
        raise LoginError(f"{where} has no {kind} {name!r}; it has: {known}") from None


def _tls(cluster: Mapping[str, Any]) -> ssl.SSLContext:
    if cluster.get("insecure-skip-tls-verify"):
        context = ssl.create_default_context()
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
        return context
    try:
        if data := cluster.get("certificate-authority-data"):
            return _trusting(cadata=_decode(data, "certificate-authority-data").decode())
        return _trusting(cafile=cluster.get("certificate-authority"))
    except (OSError, ssl.SSLError, UnicodeDecodeError) as error:
        raise LoginError(f"the cluster's certificate authority cannot be loaded: {error}") from error


def _trusting(*, cafile: str | None = None, cadata: str | None = None) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=cafile, cadata=cadata)
    # Python 3.13 turned strict X.509 on; many clusters' own authorities lack the key identifiers it wants.
    context.verify_flags &= ~ssl.VERIFY_X509_STRICT
    return context


def _decode(data: str, key: str) -> bytes:
    try:
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError) as error:
        raise LoginError(f"the kubeconfig's {key} is not base64") from error


def _client_certificate(tls: ssl.SSLContext, user: Mapping[str, Any]) -> bool:
    """Load the user's, if there is one."""
    pair = []
    for key in ("client-certificate", "client-key"):
        if data := user.get(f"{key}-data"):
            pair.append(_decode(data, f"{key}-data"))
        elif path := user.get(key):
            try:
                pair.append(Path(path).read_bytes())
            except OSError as error:
                raise LoginError(f"cannot read the {key} {path}: {error.strerror}") from error
    if len(pair) == 1:
        raise LoginError("the kubeconfig's user has a client certificate without its key, or the reverse")
    if pair:
        load_pair(tls, pair[0], pair[1])
    return bool(pair)


def _credentials(
    user: Mapping[str, Any],
    cluster: Mapping[str, Any],
    tls: ssl.SSLContext | None,
    *,
    read_again: Callable[[], Mapping[str, Any]],
) -> Credentials:
    if path := user.get("tokenFile"):
        return Credentials(file_source(Path(path)))
    if token := user.get("token"):
        return Credentials.renewable(str(token), lambda: str(read_again().get("token") or ""))
    if plugin := user.get("exec"):
        known = ("server", "certificate-authority-data", "insecure-skip-tls-verify", "tls-server-name", "proxy-url")
        return Credentials(
            ExecPlugin(
                command=str(plugin["command"]),
                args=[str(arg) for arg in plugin.get("args") or ()],
                env={item["name"]: item["value"] for item in plugin.get("env") or ()},
                api_version=plugin.get("apiVersion") or "client.authentication.k8s.io/v1",
                install_hint=plugin.get("installHint") or "",
                cluster={k: cluster[k] for k in known if k in cluster} if plugin.get("provideClusterInfo") else None,
                context=tls,
            )
        )
    return Credentials()
