"""Plugin files are looked at from a safe distance before they are imported."""

import time

import numpy as np
import pytest

from benchmark.errors import ConfigurationError
from benchmark.plugins import modules, remote
from benchmark.plugins.inspection import describe, inspect
from tests.plugins.written import write_plugin

pytestmark = pytest.mark.usefixtures("forked_workers")


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"on_import": "raises"}, "cannot be imported: ZeroDivisionError: division by zero; correct the file"),
        ({"on_import": "sys-exits"}, "cannot be imported: SystemExit: 0"),
        ({"on_import": "import no_such_module"}, "install 'no_such_module', or put no_such_module.py beside the file"),
        ({"on_making": "raises"}, "tried cannot be created: ZeroDivisionError: .*give every parameter a valid default"),
        ({"on_making": "sys-exits"}, "tried cannot be created: SystemExit: 0"),
        ({"field": "needed: int"}, "tried cannot be created: TypeError: .*missing 1 required .*'needed'"),
        ({"field": "lock: Any = field(default_factory=threading.Lock)"}, "cannot be written as JSON .lock"),
        ({"on_import": "import numpy; numpy.asarray = None"}, "changes numpy.asarray, .* do not modify other modules"),
        ({"on_making": "time.sleep = print"}, "changes time.sleep"),
        ({"name": 5}, "Tried: name 5 is not lower-case words joined by hyphens; use"),
        ({"name": "finished"}, "name 'finished' stands for several methods on the command line; choose another name"),
        ({"name": "Big Name"}, "name 'Big Name' is not lower-case words"),
        ({"name": "a" * 61}, "60 characters at most"),
        ({"info": "title=None"}, "title None is not a text of one line; write a text"),
        ({"info": "title='Odd', departs='a\\nb'"}, "departs 'a.*b' is not a text of one line; write a text"),
        ({"info": "title=''"}, "title is empty; write the text for the tables"),
        ({"info": "title='T', inputs=('image',)"}, "inputs are .'image',.; name 'mesh', 'view' or both in a tuple"),
        ({"info": "title='T', inputs=5"}, "inputs are 5"),
        ({"info": "title='T', requires='numpy'"}, "requires is 'numpy'; write a tuple"),
        ({"info": "title='T', scale='large'"}, "scale is 'large'; write 'equivariant' or 'invariant'"),
        ({"info": "title='T', family=None"}, "family is None; write 'extended'"),
        ({"info": "title='T', deterministic=1"}, "deterministic is 1; write True or False"),
    ],
)
def test_what_a_method_cannot_be_is_named_with_its_hint(faults, message, tmp_path, monkeypatch):
    monkeypatch.setattr(np, "asarray", np.asarray)  # some change them
    monkeypatch.setattr(time, "sleep", time.sleep)
    with pytest.raises(ConfigurationError, match=message):
        describe(str(write_plugin(tmp_path / "tried.py", **faults)))


@pytest.mark.parametrize(
    ("faults", "said"),
    [
        ({"on_import": "exits"}, "ended its process (exit code 0); correct the file"),
        ({"on_import": "crashes"}, "ended its process (SIGSEGV); correct the file"),
        ({"on_making": "hangs"}, "does not end: stopped after 1 s; correct the file"),
        ({"on_import": "interrupts"}, "raises KeyboardInterrupt; correct the file"),
        ({"on_import": "os.close(2)"}, "closes or replaces a standard stream; keep input and output open"),
        ({"on_making": "sys.stdout = None"}, "closes or replaces a standard stream; keep input and output open"),
    ],
)
def test_a_plugin_that_would_end_or_hold_this_process_is_refused_from_outside(faults, said, tmp_path, monkeypatch):
    monkeypatch.setattr(remote, "LIMIT", 1.0)
    path = write_plugin(tmp_path / "tried.py", **faults)
    with pytest.raises(ConfigurationError) as caught:
        inspect([path])
    assert str(caught.value).startswith(f"plugin {path} {said}")
    assert not modules.is_imported(str(path))


def test_a_look_that_somebody_ends_is_taken_again(tmp_path):
    once = "path = __file__ + '.seen'; seen = os.path.exists(path); open(path, 'w').close()\n"
    path = write_plugin(tmp_path / "tried.py", on_import=once + "seen or os.kill(os.getpid(), signal.SIGKILL)")
    inspect([path])
    path = write_plugin(tmp_path / "always.py", on_import="os.kill(os.getpid(), signal.SIGKILL)")
    with pytest.raises(ConfigurationError, match="ended its process .SIGKILL.; correct the file"):
        inspect([path])


@pytest.mark.slow
def test_packages_of_others_may_be_imported(tmp_path):
    imports = "import numba, torch, trimesh, igl, pymeshlab, sklearn.cluster, pandas, matplotlib.pyplot, scipy.optimize"
    inspect([write_plugin(tmp_path / "tried.py", on_import=imports)])
