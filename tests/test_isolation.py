"""Tests run in temporary folders: none reads the working directory or the caches of a user."""

import json
import os
import tempfile
from pathlib import Path

import pytest
from session import FOLDERS, python

ROOT = Path(__file__).parents[1]
ON_THE_SPOT = (
    "import json, os, platformdirs, sys, t2twin.core.cache_dir as cache\n"
    "print(json.dumps([os.getcwd(), os.path.expanduser('~'), str(cache.cache_dir()),"
    " platformdirs.user_cache_dir(), platformdirs.user_config_dir()]))"
)
"""Prints the folders that a command finds by itself."""


@pytest.fixture(scope="module")
def module_folder():
    return Path.cwd()


def is_temporary(folder: str | Path) -> bool:
    """Whether a folder lies in the temporary directory, and not in the repository."""
    path = Path(folder).resolve()
    return path.is_relative_to(Path(tempfile.gettempdir()).resolve()) and not (
        path.is_relative_to(ROOT)
    )


def test_a_test_runs_in_its_own_empty_folder(tmp_path, module_folder):
    assert Path.cwd() == tmp_path and list(tmp_path.iterdir()) == []
    assert is_temporary(module_folder) and list(module_folder.iterdir()) == []
    for folder in ("data", "runs", "report"):
        assert not Path(folder).exists()


def test_commands_find_temporary_folders_alone():
    done = python("-c", ON_THE_SPOT)
    for folder in (*json.loads(done.stdout), *(os.environ[name] for name in FOLDERS)):
        assert is_temporary(folder), folder


def test_runs_of_the_repository_are_not_found():
    from t2twin.studio.translators import Translators
    from t2twin.translate.runs.config import pretrained_runs

    assert set(Translators().names) <= set(pretrained_runs())
