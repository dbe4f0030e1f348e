"""Checks of files for containers, machines, workflows and citation, and of what Windows lacks."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
import urllib.request
from contextlib import suppress
from dataclasses import fields
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from import_graph import MODULES, parsed

import bodysense
from bodysense_live.security.safety import Access
from bodysense_live.server.settings import ServerSettings

from ..live.conftest import free_port, serving

yaml = pytest.importorskip("yaml", reason="needs the extra deploy")
ROOT = Path(__file__).parents[2]
DEPLOY, WORKFLOWS = ROOT / "extras" / "deploy", sorted((ROOT / ".github" / "workflows").glob("*.yml"))
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
PODS = {
    (one["kind"], one["metadata"]["name"]): one for one in yaml.safe_load_all((DEPLOY / "kubernetes.yaml").read_text())
}
SERVER = PODS["Deployment", "bodysense"]["spec"]["template"]["spec"]["containers"][0]
DOCKERFILE = (ROOT / "Dockerfile").read_text()


def passes(program: str, *arguments: object, **environment: str) -> None:
    """Run a checker of the extra deploy, or of Debian."""
    here = Path(sys.executable).with_name(program)
    found = str(here) if here.exists() else shutil.which(program)
    if found is None:
        pytest.skip(f"needs {program}")
    command = [found, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def docker(instruction: str) -> Any:
    """The list after the last line of a Dockerfile that begins so."""
    return json.loads(re.findall(rf"^ *{instruction} (\[.*\])$", DOCKERFILE, re.MULTILINE)[-1])


def test_checkers_accept_every_file() -> None:
    passes("hadolint", ROOT / "Dockerfile")
    passes("check-jsonschema", "--builtin-schema", "vendor.compose-spec", DEPLOY / "compose.yaml")
    passes("check-jsonschema", "--builtin-schema", "vendor.github-workflows", *WORKFLOWS)
    passes("check-jsonschema", "--builtin-schema", "vendor.citation-file-format", ROOT / "CITATION.cff")
    passes("kubernetes-validate", "--strict", DEPLOY / "kubernetes.yaml")
    passes("zizmor", "--offline", "--no-progress", ROOT / ".github")


def test_haproxy_accepts_its_file_and_compose_sets_its_variables() -> None:
    text = (DEPLOY / "haproxy.cfg").read_text()
    given = COMPOSE["services"]["haproxy"]["environment"]
    assert set(re.findall(r"\$\{(\w+)\}", text)) == set(given)
    assert {given["ONE"], given["TWO"]} == {"one:8765", "two:8765"} and {"one", "two"} <= COMPOSE["services"].keys()
    passes("haproxy", "-c", "-f", DEPLOY / "haproxy.cfg", LISTEN="127.0.0.1:8080", ONE="127.0.0.1:1", TWO="127.0.0.1:2")


@pytest.mark.parametrize(
    "command", [docker("ENTRYPOINT")[1:] + docker("CMD"), COMPOSE["services"]["one"]["command"], SERVER["args"]]
)
def test_servers_are_started_with_options_that_there_are(command: list[str]) -> None:
    from bodysense_live.commands import serve_options

    assert command[0] == "serve" and command[1:3] == ["--host", "0.0.0.0"]
    groups = [group for name, group in vars(serve_options).items() if name.endswith("Options")]
    options = {f"--{field.name.replace('_', '-')}" for group in groups for field in fields(group)}
    assert {word for word in command if word.startswith("--")} <= options


def test_servers_reach_the_store_by_its_name() -> None:
    for command in (COMPOSE["services"]["one"]["command"], SERVER["args"]):
        address = command[command.index("--shared") + 1]
        host, port = re.fullmatch(r"redis://([\w-]+):(\d+)", address).groups()  # type: ignore[union-attr]
        assert host in COMPOSE["services"] or PODS["Service", host]["spec"]["ports"][0]["port"] == int(port)
    assert (
        PODS["Service", "bodysense-valkey"]["spec"]["selector"]
        == (PODS["Deployment", "bodysense-valkey"]["spec"]["template"]["metadata"]["labels"])
    )


def test_no_command_has_a_secret_and_every_store_has_a_password() -> None:
    services = [service for name, service in COMPOSE["services"].items() if name != "haproxy"]
    pods = [one["spec"]["template"]["spec"] for (kind, _), one in PODS.items() if kind == "Deployment"]
    for command in (*(one["command"] for one in services), *(pod["containers"][0].get("args", []) for pod in pods)):
        assert "--token" not in command and not re.search(r"\$\{|\$\([A-Z]", " ".join(command))
    for pod in pods:
        assert "env" not in pod["containers"][0]
        (secret,) = [one["secret"] for one in pod["volumes"] if "secret" in one]
        assert secret["secretName"] == "bodysense" and secret["defaultMode"] == 0o440
    for command in (COMPOSE["services"]["valkey"]["command"], pods[1]["containers"][0]["command"]):
        assert "requirepass" in command[2] and "--shared-password-file" in SERVER["args"]
    mounted = SERVER["volumeMounts"][1]["mountPath"]
    assert {word for word in SERVER["args"] if word.startswith(mounted)} == {f"{mounted}/token", f"{mounted}/valkey"}


def test_the_valkey_of_the_files_asks_for_its_password(tmp_path: Path) -> None:
    """Run the container's command here, with the secret in another folder and Debian's server."""
    program = shutil.which("valkey-server") or shutil.which("redis-server")
    if program is None:
        pytest.skip("needs Debian's valkey-server or redis-server")
    redis = pytest.importorskip("redis", reason="needs packages/live[shared]")
    (tmp_path / "valkey").write_text("a-password")
    shell, option, text = PODS["Deployment", "bodysense-valkey"]["spec"]["template"]["spec"]["containers"][0]["command"]
    port = free_port()
    text = text.replace("/run/secrets/bodysense", str(tmp_path)).replace("valkey-server", f"{program} --port {port}")
    text = re.sub(rf"({re.escape(program)}) (--port {port}) -", r"\1 - \2", text)
    with subprocess.Popen([shell, option, text], stdout=subprocess.DEVNULL, cwd=tmp_path) as process:
        try:
            client = redis.Redis(port=port, password="a-password")
            for _ in range(100):
                with suppress(redis.exceptions.ConnectionError):
                    assert client.ping()
                    break
                time.sleep(0.05)
            assert client.config_get("save") == {"save": ""}
            with pytest.raises(redis.exceptions.AuthenticationError):
                redis.Redis(port=port).ping()
            client.shutdown(nosave=True)
        finally:
            process.wait(10)


def test_the_proxy_names_clients_and_servers_are_behind_a_policy() -> None:
    assert re.search(r"^ +option forwardfor$", (DEPLOY / "haproxy.cfg").read_text(), re.MULTILINE)
    command = COMPOSE["services"]["one"]["command"]
    (network,) = COMPOSE["networks"]["default"]["ipam"]["config"]
    assert command[command.index("--trusted-proxy") + 1] == network["subnet"] and "--trusted-proxy" in SERVER["args"]
    for name in ("bodysense", "bodysense-valkey"):
        policy = PODS["NetworkPolicy", name]["spec"]
        labels = PODS["Deployment", name]["spec"]["template"]["metadata"]["labels"]
        assert policy["podSelector"]["matchLabels"] == labels and "Ingress" in policy["policyTypes"]
    assert "Egress" in PODS["NetworkPolicy", "bodysense"]["spec"]["policyTypes"]


def test_probes_and_metrics_are_those_of_the_server() -> None:
    with serving(ServerSettings(access=Access(token="secret-99"))) as server:
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            with urllib.request.urlopen(server.http + SERVER[probe]["httpGet"]["path"], timeout=10) as answer:
                assert answer.status == 200
        (monitored,) = PODS["PodMonitor", "bodysense"]["spec"]["podMetricsEndpoints"]
        bearer = {"Authorization": "Bearer secret-99"}
        requested = urllib.request.Request(server.http + monitored["path"], headers=bearer)
        with urllib.request.urlopen(requested, timeout=10) as answer:
            text = answer.read().decode()
    named = PODS["HorizontalPodAutoscaler", "bodysense"]["spec"]["metrics"][1]["pods"]["metric"]["name"]
    assert f"\n{named}_seconds_total " in text
    assert SERVER["ports"][0]["containerPort"] == 8765 and "\nEXPOSE 8765\n" in DOCKERFILE


def test_every_container_runs_without_rights() -> None:
    for kind, name in PODS:
        if kind == "Deployment":
            pod = PODS[kind, name]["spec"]["template"]["spec"]
            assert pod["securityContext"]["runAsNonRoot"] and not pod["automountServiceAccountToken"]
            for container in pod["containers"]:
                assert container["securityContext"]["readOnlyRootFilesystem"]
                assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
    last = DOCKERFILE.rpartition("FROM")[2]
    assert re.search(r"^USER 10001$", last, re.MULTILINE)


def installed_with(name: str, extras: tuple[str, ...], found: set[str]) -> set[str]:
    """Names of a package and of all that it needs on this machine, as far as these are installed."""
    requirements = pytest.importorskip("packaging.requirements")
    found.add(name.lower().replace("_", "-"))
    try:
        lines = metadata.distribution(name).requires or []
    except metadata.PackageNotFoundError:
        return found
    for line in lines:
        needed = requirements.Requirement(line)
        wanted = needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in ("", *extras))
        if wanted and (needed.extras or needed.name.lower().replace("_", "-") not in found):
            installed_with(needed.name, tuple(needed.extras), found)
    return found


def test_credits_name_every_package_of_the_image() -> None:
    (line,) = re.findall(r'"/src/packages/live\[(\w+)\]"', DOCKERFILE)
    page = (ROOT / "docs" / "credits.md").read_text().partition("## Software in the packages and the image")[2]
    named = re.sub(r"[ _]", "-", page.partition("\n## ")[0].lower())
    packages = {"onnxruntime": "onnx-runtime"}
    for name in installed_with("bodysense-live", (line,), set()):
        assert re.search(rf"\b{packages.get(name, name)}\b", named), name


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == bodysense.__version__
    assert SERVER["image"] == f"bodysense:{bodysense.__version__}"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_publish_without_passwords_and_run_what_there_is(path: Path) -> None:
    text = path.read_text()
    jobs = yaml.safe_load(text)["jobs"]
    assert "secrets." not in text
    trusted = {name for name, job in jobs.items() if "write" in job.get("permissions", {}).values()}
    assert trusted <= {"publish", "attest", "attach"}
    for name in trusted:  # a job that may publish runs no code of the repository
        assert not any("checkout" in step.get("uses", "") for step in jobs[name]["steps"])
    assert "publish" not in jobs or jobs["publish"]["environment"]
    for script in re.findall(r"scripts/\w+\.py", text):
        assert (ROOT / script).is_file()
    for folder in re.findall(r"working-directory: (\S+)", text):
        assert (ROOT / folder / "package.json").is_file()


def test_every_supported_python_is_tested_on_a_push() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text())
    assert "push" in workflow[True]  # YAML's "on"
    pythons = workflow["jobs"]["fast"]["strategy"]["matrix"]["python"]
    assert project["requires-python"] == f">={pythons[0]}"
    assert pythons == [f"3.{minor}" for minor in range(11, 15)]


UNIX = {"fcntl", "pwd", "grp", "termios", "tty", "pty", "resource", "syslog"}  # modules that Windows lacks
MISSING = {"fork", "forkpty", "getuid", "geteuid", "mkfifo", "sysconf", "SIGKILL", "SIGHUP", "add_signal_handler"}
STARTS = {"get_context", "set_start_method"}  # of processes, which only "spawn" starts everywhere
MEASURING = ("bench/timing.py",)  # of the laboratory, on Unix


def test_nothing_takes_unix_for_granted() -> None:
    word, found = re.compile(rf"\b({'|'.join([*UNIX, *MISSING, *STARTS])})\b"), []
    for module, path in MODULES.items():
        if path.as_posix().endswith(MEASURING) or not word.search(path.read_text(encoding="utf-8")):
            continue
        for node in ast.walk(parsed(module)):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names if alias.name in UNIX]
            elif isinstance(node, ast.ImportFrom) and node.module in UNIX:
                names = [node.module]
            elif isinstance(node, ast.Attribute) and node.attr in MISSING:
                names = [node.attr]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
                names = [called] if called in STARTS and [ast.unparse(one) for one in node.args] != ["'spawn'"] else []
            found += [f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}: {name}" for name in names]
    assert not found
