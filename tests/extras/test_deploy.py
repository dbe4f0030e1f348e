"""Checks of files for containers, machines, workflows and citation, and of what Windows lacks."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import urllib.request
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

import bodysense
from bodysense_live.security.safety import Access
from bodysense_live.server.settings import ServerSettings

from ..live.conftest import serving

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


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == bodysense.__version__
    assert SERVER["image"] == f"bodysense:{bodysense.__version__}"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_publish_without_passwords_and_run_what_there_is(path: Path) -> None:
    text = path.read_text()
    jobs = yaml.safe_load(text)["jobs"]
    assert "secrets." not in text
    publish = jobs["publish"]
    assert publish["permissions"]["id-token"] == "write" and publish["environment"]
    assert all("id-token" not in job.get("permissions", {}) for name, job in jobs.items() if name != "publish")
    for script in re.findall(r"scripts/\w+\.py", text):
        assert (ROOT / script).is_file()
    for folder in re.findall(r"working-directory: (\S+)", text):
        assert (ROOT / folder / "package.json").is_file()


UNIX = {"fcntl", "pwd", "grp", "termios", "tty", "pty", "resource", "syslog"}  # modules that Windows lacks
MISSING = {"fork", "forkpty", "getuid", "geteuid", "mkfifo", "sysconf", "SIGKILL", "SIGHUP", "add_signal_handler"}
MEASURING = ("bench/timing.py",)  # of the laboratory, on Unix


@pytest.mark.parametrize("package", ["src/bodysense", *(f"packages/{name}/src" for name in ("live", "conform", "lab"))])
def test_nothing_takes_unix_for_granted(package: str) -> None:
    found = []
    for path in sorted((ROOT / package).rglob("*.py")):
        if path.as_posix().endswith(MEASURING):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names if alias.name in UNIX]
            elif isinstance(node, ast.ImportFrom) and node.module in UNIX:
                names = [node.module]
            elif isinstance(node, ast.Attribute) and node.attr in MISSING:
                names = [node.attr]
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
                called = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
                starts = called in ("get_context", "set_start_method")
                names = [called] if starts and [ast.unparse(one) for one in node.args] != ["'spawn'"] else []
            found += [f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}: {name}" for name in names]
    assert not found
