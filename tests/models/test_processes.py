import json
import os
import socket
import subprocess
import sys
from contextlib import nullcontext

import pytest
import torch
from torch import nn

from pgm_models.processes import Processes, device_of
from pgm_models.train import LOG_NAME, Batch, Task, TrainOptions, train

SCRIPT = """
import sys
from pathlib import Path
import torch
from torch import nn
from pgm_models.train import Batch, Task, TrainOptions, train

class Plane(Task):
    def batch(self, index):
        x = torch.randn(8, 3, generator=torch.Generator().manual_seed(index))
        return Batch(tensors={"x": x, "y": x @ torch.tensor([[1.0], [2.0], [-1.0]])}, names=(f"b{index}",))

    def loss(self, network, batch):
        noise = 0.1 * torch.randn(8, 3)
        loss = ((network(batch.tensors["x"] + noise) - batch.tensors["y"]) ** 2).mean()
        return loss, {"square": loss.detach()}

    def validate(self, network):
        return {}

    def describe(self):
        return {"what": "a plane"}

torch.manual_seed(0)
network = nn.Sequential(nn.Linear(3, 16), nn.Tanh(), nn.Linear(16, 1))
options = TrainOptions(steps=12, accumulate=2, log_every=1, threads=1, learning_rate=0.02)
outcome = train(network, Plane(), options, Path(sys.argv[1]), provenance={"command": ["test"]})
assert outcome.state == "done"
"""


def _losses(run):
    lines = [json.loads(line) for line in (run / LOG_NAME).read_text().splitlines()]
    assert [line["step"] for line in lines] == list(range(1, 13))
    return [line["loss"] for line in lines], [line["gradient"] for line in lines]


def test_two_processes_have_the_losses_of_one(tmp_path, monkeypatch):
    script = tmp_path / "plane.py"
    script.write_text(SCRIPT)
    # As torchrun starts them, without a third process to start them in.
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    group = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "OMP_NUM_THREADS": "1"}
    command = [sys.executable, script, tmp_path / "two"]
    ranks = [
        subprocess.Popen(command, env=os.environ | group | {"RANK": rank}, stderr=subprocess.PIPE, text=True)
        for rank in ("0", "1")
    ]
    try:
        said = [rank.communicate(timeout=300)[1] for rank in ranks]
    finally:
        for rank in ranks:
            rank.kill()
            rank.wait()
    assert [rank.returncode for rank in ranks] == [0, 0], said[0][-2000:] + said[1][-2000:]
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path / "one")])
    exec(compile(SCRIPT, str(script), "exec"), {"__name__": "__main__"})
    torch.testing.assert_close(_losses(tmp_path / "one"), _losses(tmp_path / "two"), rtol=1e-5, atol=1e-7)


def test_parts_of_a_step_must_be_shared_out_evenly(tmp_path, monkeypatch):
    monkeypatch.setattr("pgm_models.train.joined", lambda device: nullcontext(Processes(rank=0, count=2)))
    with pytest.raises(ValueError, match="multiple of the 2 processes, got 3"):
        train(nn.Linear(1, 1), Line(), TrainOptions(steps=1, accumulate=3, threads=1), tmp_path, provenance={})


class Line(Task):
    def batch(self, index):
        return Batch(tensors={}, names=())

    def loss(self, network, batch):
        return torch.zeros(()), {}

    def validate(self, network):
        return {}

    def describe(self):
        return {}


def test_devices_that_are_not_there_are_named():
    assert device_of("cpu") == torch.device("cpu")
    with pytest.raises(ValueError, match="expected auto, cpu"):
        device_of("toaster")
    if not torch.cuda.is_available():
        assert device_of("auto") == torch.device("cpu")
        with pytest.raises(ValueError, match="expected a GPU for 'cuda', found none"):
            device_of("cuda")
