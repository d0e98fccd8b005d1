"""Campaigns on Dask clusters that exist: one in this process, one started by hand on loopback."""

import socket
import subprocess
import sys

import pytest

from holdfast import RefusedError
from lab.studies import campaign
from lab.studies.campaign import Campaign
from lab.studies.campaign_cases import case
from lab.study import dived as on_workers
from lab.study import parser_of, workforce

distributed = pytest.importorskip("distributed")
pytestmark = [pytest.mark.compiles, pytest.mark.filterwarnings("default")]  # Dask's own warnings

NUMBERS = (0, 2, 3)


def dived(address):
    """Dive NUMBERS on the cluster at `address`; return outcomes by number, and the workers it found."""
    study = Campaign(parser_of(Campaign).parse_args([]))
    groups = study.groups([case(number) for number in NUMBERS])
    with workforce(address, None) as (executor, workers):
        found = list(on_workers(study, groups, executor, workers))
    outcomes = [zip(cases, rows, strict=True) for cases, rows, _ in found]
    return {one.number: row["outcome"] for pairs in outcomes for one, row in pairs}, workers


def test_a_local_cluster(monkeypatch):
    monkeypatch.setattr(campaign, "DURATION_S", 3.6)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        outcomes, workers = dived(cluster.scheduler_address)
    assert outcomes == dict.fromkeys(NUMBERS, "held")
    assert workers == 1


def test_a_scheduler_and_a_worker_started_by_hand(tmp_path, monkeypatch):
    monkeypatch.setattr("lab.study.CONNECT_S", 100.0)  # Dask starts slowly on a busy machine
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
    monkeypatch.setattr("lab.study.CONNECT_S", 0.5)
    with pytest.raises(RefusedError, match="no Dask scheduler answers"), workforce("tcp://127.0.0.1:9", None):
        pass
