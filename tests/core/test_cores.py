"""The number of cores that a process may use: the least that affinity, cgroups and SLURM allow."""

import os
import subprocess
import sys

import pytest

from saf_gen.core.cores import cgroup_quota, usable_cores

V1 = "4:cpuset:/\n3:cpu,cpuacct:{path}\n2:pids:/\n1:name=systemd:/\n0::/"
V1_MOUNTS = (
    "36 25 0:31 {top} /sys/fs/cgroup/cpu,cpuacct rw - cgroup cgroup rw,cpu,cpuacct\n30 23 0:27 / /proc rw - proc - rw"
)
V2_MOUNTS = "24 1 0:22 / /sys rw shared:7 - sysfs sysfs rw\n30 24 0:26 {top} /sys/fs/cgroup ro - cgroup2 cgroup rw"
AFFINITY = len(os.sched_getaffinity(0))


def make_root(folder, *, groups, mounts, files):
    texts = {"proc/self/cgroup": groups, "proc/self/mountinfo": mounts}
    for name, text in (texts | {f"sys/fs/cgroup/{name}": text for name, text in files.items()}).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")
    return folder


@pytest.mark.parametrize(
    ("path", "top", "files", "cores"),
    [
        ("/", "/", {}, None),
        ("/", "/", {"cpu.max": "max 100000"}, None),
        ("/", "/", {"cpu.max": "200000 100000"}, 2),
        ("/", "/", {"cpu.max": "250000 100000"}, 3),
        ("/", "/", {"cpu.max": "1000 100000"}, 1),
        ("/", "/", {"cpu.max": "75000 50000"}, 2),
        ("/job/step", "/", {"job/step/cpu.max": "400000 100000"}, 4),
        ("/job/step", "/", {"job/cpu.max": "100000 100000", "job/step/cpu.max": "400000 100000"}, 1),
        ("/job/step", "/", {"job/cpu.max": "400000 100000", "job/step/cpu.max": "max 100000"}, 4),
        ("/job/step", "/", {"other/cpu.max": "100000 100000"}, None),
        ("/docker/a", "/docker/a", {"cpu.max": "300000 100000"}, 3),  # a container without a namespace of cgroups
        ("/docker/a/b", "/docker/a", {"b/cpu.max": "300000 100000"}, 3),
        ("/", "/", {"cpu.max": "damaged"}, None),
        ("/", "/", {"cpu.max": ""}, None),
    ],
)
def test_a_quota_of_version_2_counts_rounded_up_with_those_of_parent_groups(tmp_path, path, top, files, cores):
    root = make_root(tmp_path, groups=f"0::{path}", mounts=V2_MOUNTS.format(top=top), files=files)
    assert cgroup_quota(root) == cores


@pytest.mark.parametrize(
    ("path", "top", "quotas", "cores"),
    [
        ("/", "/", {"": -1}, None),
        ("/", "/", {"": 150_000}, 2),
        ("/slurm/job", "/", {"": -1, "slurm/": 350_000, "slurm/job/": -1}, 4),
        ("/slurm/job", "/", {"slurm/": 350_000, "slurm/job/": 100_000}, 1),
        ("/docker/a", "/docker/a", {"": 50_000}, 1),
    ],
)
def test_a_quota_of_version_1_counts_likewise(tmp_path, path, top, quotas, cores):
    files = {f"cpu,cpuacct/{at}cpu.cfs_quota_us": quota for at, quota in quotas.items()}
    files |= {f"cpu,cpuacct/{at}cpu.cfs_period_us": 100_000 for at in quotas}
    root = make_root(tmp_path, groups=V1.format(path=path), mounts=V1_MOUNTS.format(top=top), files=files)
    assert cgroup_quota(root) == cores


def test_a_system_without_cgroups_has_no_quota(tmp_path):
    assert cgroup_quota(tmp_path / "empty") is None
    assert cgroup_quota(make_root(tmp_path, groups="", mounts="not such a table", files={})) is None


@pytest.mark.parametrize(
    ("slurm", "cores"),
    [("1", 1), ("", AFFINITY), ("0", AFFINITY), ("many", AFFINITY), ("-1", AFFINITY), ("100000", AFFINITY)],
)
def test_a_job_of_slurm_uses_the_cores_of_its_task_if_they_are_fewer(monkeypatch, slurm, cores):
    monkeypatch.delenv("SLURM_CPUS_PER_TASK", raising=False)
    before = usable_cores()
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", slurm)
    assert usable_cores() == min(before, cores)


def test_affinity_counts():
    code = "import os, saf_gen.core.cores as c; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"
    command = [sys.executable, "-c", f"{code}; print(c.usable_cores())"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "1\n"
