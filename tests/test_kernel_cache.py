"""Compiled kernels of a user who may write neither into the suite nor into a home."""

import os
import stat
from pathlib import Path

import pytest

from benchmark.kernel_cache import VARIABLE, choose_kernel_cache


@pytest.fixture
def chosen(tmp_path, monkeypatch):
    """Choose a folder where nothing but temporary files can be written."""

    def choose(home="/nonexistent"):
        monkeypatch.setenv("HOME", home)
        monkeypatch.setenv(VARIABLE, "")  # so that what is set here does not stay
        monkeypatch.delenv(VARIABLE)
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        monkeypatch.setattr(os, "access", lambda path, mode: Path(path).is_relative_to(tmp_path))
        choose_kernel_cache()
        return os.environ.get(VARIABLE)

    return choose


def test_without_a_home_they_go_into_a_new_folder_of_the_user_alone(chosen, tmp_path):
    folder = Path(chosen())
    assert folder.parent == tmp_path
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert chosen() != str(folder)


def test_a_home_is_used(chosen, tmp_path):
    assert chosen(str(tmp_path / "home")) == str(tmp_path / "home/.cache/canonical-forms-kernels")


def test_a_home_that_others_can_write_to_is_not_trusted(chosen, tmp_path):
    trap = tmp_path / "home/.cache/canonical-forms-kernels"
    trap.mkdir(parents=True)
    trap.chmod(0o777)
    assert Path(chosen(str(tmp_path / "home"))).parent == tmp_path
