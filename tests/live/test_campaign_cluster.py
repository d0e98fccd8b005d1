"""Campaigns on Dask clusters that exist: one in this process, one started by hand on loopback."""

import socket
import subprocess
import sys

import pytest

from companion.config import load_config
from lab.campaign import campaign
from lab.campaign.campaign import run
from lab.campaign.report import workforce

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("default")  # Dask's own

NUMBERS = (0, 2, 3)


def dived(address):
    """Dive NUMBERS on the cluster at `address`; return outcomes by number, and the workers it found."""
    with workforce(address, None) as (executor, workers):
        batches = list(run(executor, workers, load_config(), NUMBERS))
    return {row.case.number: row.outcome for batch in batches for row in batch.rows}, workers


def test_a_local_cluster(monkeypatch):
    monkeypatch.setattr(campaign, "DURATION_S", 3.6)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        outcomes, workers = dived(cluster.scheduler_address)
    assert outcomes == dict.fromkeys(NUMBERS, "held")
    assert workers == 1


def test_a_scheduler_and_a_worker_started_by_hand(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    dask = [sys.executable, "-m", "dask"]
    here = ["--host", "127.0.0.1", "--no-dashboard"]
    started = [
        [*dask, "scheduler", *here, "--port", address.rpartition(":")[2]],
        [
            *dask,
            "worker",
            address,
            *here,
            "--nthreads",
            "1",
            "--no-nanny",
            "--local-directory",
            str(tmp_path),
        ],
    ]
    log = (tmp_path / "log").open("wb")
    processes = [subprocess.Popen(command, stdout=log, stderr=log) for command in started]
    try:
        outcomes, workers = dived(address)
    finally:
        for (
            process
        ) in processes:  # how a worker takes a polite word while its scheduler leaves is Dask's affair
            process.kill()
            process.wait()
        log.close()
    assert outcomes == dict.fromkeys(NUMBERS, "held")
    assert workers == 1


def test_no_scheduler_is_said_in_a_sentence(monkeypatch):
    monkeypatch.setattr("lab.campaign.report.CONNECT_S", 0.5)
    with pytest.raises(SystemExit, match="no Dask scheduler answers"), workforce("tcp://127.0.0.1:9", None):
        pass
