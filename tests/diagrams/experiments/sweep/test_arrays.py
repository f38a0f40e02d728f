"""Trials on arrays: the same again, moving, and within the limits."""

import numpy as np
import pytest
from experiments.sweep.arrays import TRIALS
from experiments.sweep.arrays_command import main, run_block


@pytest.mark.parametrize("case", TRIALS)
def test_trials_repeat_and_violate_nothing(case):
    rows, again = run_block(case, 1, 0, 12), run_block(case, 1, 4, 4)
    for name, values in again.items():
        np.testing.assert_array_equal(values, rows[name][4:8], err_msg=name)
    assert not rows["violated"].any()


def test_adversaries_are_some():
    """Limits are reached, not only kept: commands that nothing has to hold back would show nothing."""
    envelope, stop = run_block("envelope", 0, 0, 12), run_block("stop", 0, 0, 40)
    assert envelope["speed_share"].max() > 0.99 and envelope["rate_share"].max() > 0.99
    assert (stop["moved_share"] > 0.2).sum() > 5 and (stop["stopping_share"] > 0.0).sum() > 5
    assert run_block("nmpc", 0, 0, 12)["speed_share"].max() > 0.5


def test_the_command_writes_a_table_a_block(tmp_path, capsys):
    pytest.importorskip("pyarrow", reason="the extra sweep is not installed")
    assert main(["--case", "stop", "--trials", "3", "--workers", "1", "--out", str(tmp_path)]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["stop_0000000_0003.parquet"]
    assert "stop: 0 of 3 trials violate a limit" in capsys.readouterr().out
