"""A short run of the coverage-guided fuzzer; tests/tools/fuzz_codec.py runs as long as one likes."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest

FUZZER = Path(__file__).parent.parent / "tools" / "fuzz_codec.py"
RUNS = 20_000


@pytest.mark.skipif(platform.machine() != "x86_64", reason="atheris has no wheel for this processor")
def test_nothing_raises_for_inputs_that_coverage_leads_to(tmp_path):
    options = (f"-runs={RUNS}", "-seed=1", "-max_len=1500", "-len_control=0")
    command = (sys.executable, FUZZER, *options)
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=380,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert f"Done {RUNS} runs" in done.stderr
    assert not list(tmp_path.glob("crash-*"))
