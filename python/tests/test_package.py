"""The installed package: where it lies, its command line, its types."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import evrig
from evrig._cli import find_program

from conftest import ROOT

#: Set by the checks, which test the installed wheel; an editable installation lies in the tree.
IS_INSTALLED = "EVRIG_TEST_WHEEL" in os.environ


def run(*arguments: str, **options) -> subprocess.CompletedProcess:
    program = find_program()
    assert program is not None
    return subprocess.run([program, *arguments], capture_output=True, text=True, **options)


@pytest.mark.skipif(not IS_INSTALLED, reason="EVRIG_TEST_WHEEL is not set: no wheel under test")
def test_the_installed_wheel_is_tested_and_not_the_source_tree():
    assert ROOT / "python" not in Path(evrig.__file__).resolve().parents


def test_package_and_command_line_have_one_version():
    assert evrig.__version__ == metadata.version("evrig")
    assert run("--version").stdout.strip() == f"evrig {evrig.__version__}"


def test_the_package_is_typed():
    assert Path(evrig.__file__).with_name("py.typed").exists()


def test_exit_codes_and_streams_are_those_of_the_program(tmp_path, recording):
    made = run("import", "aedat4", str(recording), "--out", str(tmp_path / "s"))
    assert made.returncode == 0, made.stderr
    info = run("info", str(tmp_path / "s"), "--json")
    counts = {stream["name"]: stream["count"] for stream in json.loads(info.stdout)["streams"]}
    assert counts["real"] == 78830 and counts["aps"] == 59
    missing = run("info", str(tmp_path / "none"))
    assert missing.returncode == 1 and missing.stderr.startswith("error: ") and not missing.stdout
    assert run("no-such-command").returncode == 2
    assert "Usage" in run("--help").stdout


def test_the_module_runs_the_command_line():
    done = subprocess.run([sys.executable, "-m", "evrig", "--version"], capture_output=True, text=True)
    assert done.returncode == 0 and evrig.__version__ in done.stdout
