"""Tasks on a real Dask cluster of two workers, one of which is killed midway."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.sequence_factory import write_sequence

TASKS = 12

# A process of its own: the cluster starts others by importing this file again.
SCRIPT = """
import json, os, signal, sys
from pathlib import Path
from distributed import LocalCluster
from cltaa.lab.bench.accuracy.measurement import tasks_of
from cltaa.lab.bench.cells import Judging, run_all
from cltaa.lab.bench.variants import ladder
from cltaa.core.presets import load_preset

if __name__ == "__main__":
    sequence, output, count = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    tasks = tasks_of([sequence], ladder(load_preset())[:count], "numpy", Judging(metrics=("mse",), rounding_frames=2))
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        done, killed = [], None
        for task in run_all(tasks, output, dask=cluster.scheduler_address):
            done.append(task.variants[0].name)
            if killed is None:
                killed = next(iter(cluster.workers.values())).pid
                os.kill(killed, signal.SIGKILL)
    serial = output / "serial"
    for task in run_all(tasks[:3], serial):
        pass
    same = all(task.finished(serial) == task.finished(output) for task in tasks[:3])
    found = sum(task.left(output) is None for task in tasks)
    print(json.dumps({"done": len(set(done)), "found": found, "killed": killed, "same": same}))
"""


def test_a_killed_worker_loses_nothing(tmp_path: Path) -> None:
    sequence = write_sequence(tmp_path / "seq", 6, reference=True, width=97, height=61)
    script = tmp_path / "cluster.py"
    script.write_text(SCRIPT)
    command = [sys.executable, str(script), str(sequence), str(tmp_path / "out"), str(TASKS)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["killed"] is not None
    assert (result["done"], result["found"], result["same"]) == (TASKS, TASKS, True)
