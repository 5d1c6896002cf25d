import json
import math
import os
import signal

import pytest
import torch
from torch import nn

from pgm_models.checkpoint import CHECKPOINT_NAME, load_checkpoint
from pgm_models.train import LOG_NAME, Batch, Task, TrainOptions, learning_rate, train


class Line(Task):
    """y = 3 x - 1 with noise, seen through a network with dropout; batch `bad` holds a NaN."""

    def __init__(self, bad=None, interrupt_at=None):
        self.bad = bad
        self.interrupt_at = interrupt_at
        self.validations = 0

    def batch(self, index):
        generator = torch.Generator().manual_seed(index)
        x = torch.randn(8, 1, generator=generator)
        y = 3 * x - 1 + 0.1 * torch.randn(8, 1, generator=generator)
        if index == self.bad:
            y[3] = math.nan
        return Batch(tensors={"x": x, "y": y}, names=tuple(f"clip{index}/{k}" for k in range(8)))

    def loss(self, network, batch):
        if batch.names[0] == f"clip{self.interrupt_at}/0":
            os.kill(os.getpid(), signal.SIGINT)
        loss = ((network(batch.tensors["x"]) - batch.tensors["y"]) ** 2).mean()
        return loss, {"square": loss.detach()}

    def validate(self, network):
        self.validations += 1
        return {"slope": float(network(torch.ones(1, 1)) - network(torch.zeros(1, 1)))}

    def describe(self):
        return {"what": "a line"}


def network():
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(1, 32), nn.BatchNorm1d(32), nn.ReLU(), nn.Dropout(0.1), nn.Linear(32, 1))


def losses(run):
    lines = [json.loads(line) for line in (run / LOG_NAME).read_text().splitlines()]
    return {line["step"]: line["loss"] for line in lines if "loss" in line}


def go(run, *, task=None, **changes):
    options = TrainOptions(**{"steps": 40, "log_every": 1, "threads": 1, "learning_rate": 0.02} | changes)
    return train(network(), task or Line(), options, run, provenance={"command": ["test"]})


def test_a_line_is_learned(tmp_path):
    outcome = go(tmp_path, steps=300, log_every=50, average=0.95)
    slope = Line().validate(outcome.network)["slope"]
    assert outcome.state == "done"
    assert slope == pytest.approx(3.0, abs=0.4)


def test_a_resumed_run_repeats_the_unbroken_one_exactly(tmp_path):
    go(tmp_path / "whole")
    broken = go(tmp_path / "parts", task=Line(interrupt_at=17))
    assert (broken.state, broken.step) == ("interrupted", 18)
    resumed = go(tmp_path / "parts")
    assert (resumed.state, resumed.step) == ("done", 40)
    assert losses(tmp_path / "parts") == losses(tmp_path / "whole")
    whole, parts = (load_checkpoint(tmp_path / name / CHECKPOINT_NAME) for name in ("whole", "parts"))
    for kind in ("network", "average", "optimiser"):
        for name, value in getattr(whole, kind).items():
            assert torch.equal(value, getattr(parts, kind)[name]), (kind, name)


def test_a_resume_mid_accumulation_schedule_repeats_too(tmp_path):
    go(tmp_path / "whole", accumulate=3, steps=12)
    go(tmp_path / "parts", accumulate=3, steps=12, task=Line(interrupt_at=16))
    go(tmp_path / "parts", accumulate=3, steps=12)
    assert losses(tmp_path / "parts") == losses(tmp_path / "whole")


def test_accumulation_gives_the_gradient_of_the_joint_batch(tmp_path):
    class Halves(Line):
        def batch(self, index):
            joint = Line.batch(self, 0)
            half = slice(4 * (index % 2), 4 * (index % 2) + 4)
            return Batch(tensors={k: v[half] for k, v in joint.tensors.items()}, names=joint.names[half])

    def plain():
        torch.manual_seed(0)
        return nn.Linear(1, 1)

    options = {"steps": 1, "log_every": 1, "threads": 1}
    one = train(plain(), Line(), TrainOptions(**options), tmp_path / "one", provenance={})
    two = train(plain(), Halves(), TrainOptions(accumulate=2, **options), tmp_path / "two", provenance={})
    entries = [json.loads((tmp_path / name / LOG_NAME).read_text()) for name in ("one", "two")]
    assert entries[0]["gradient"] == pytest.approx(entries[1]["gradient"], rel=1e-5)
    assert one.step == two.step == 1


def test_nan_stops_and_names_the_batch_and_keeps_the_last_checkpoint(tmp_path):
    go(tmp_path, steps=10)
    before = (tmp_path / CHECKPOINT_NAME).read_bytes()
    with pytest.raises(ValueError, match=r"steps \(10 then, 20 now\)"):
        go(tmp_path, steps=20)
    with pytest.raises(FloatingPointError, match=r"step 5: .*nan on the batch clip5/0, clip5/1"):
        go(tmp_path / "other", steps=10, task=Line(bad=5))
    assert (tmp_path / CHECKPOINT_NAME).read_bytes() == before


def test_minutes_follow_the_clock_whatever_the_steps(tmp_path):
    def run(seconds_per_look, folder):
        now = [0.0]

        def clock():
            now[0] += seconds_per_look
            return now[0]

        options = TrainOptions(minutes=1.0, log_every=1, threads=1, checkpoint_minutes=0.5)
        task = Line()
        outcome = train(network(), task, options, folder, provenance={}, clock=clock)
        entries = [json.loads(line) for line in (folder / LOG_NAME).read_text().splitlines()]
        return outcome, [e["rate"] for e in entries if "rate" in e], task.validations

    fast, fast_rates, looked = run(0.1, tmp_path / "fast")
    slow, slow_rates, _ = run(1.0, tmp_path / "slow")
    assert fast.step > 5 * slow.step
    assert fast.elapsed_s == pytest.approx(60, abs=2)
    assert slow.elapsed_s == pytest.approx(60, abs=8)
    assert fast_rates[-1] < 0.01 * max(fast_rates)
    assert slow_rates[-1] < 0.1 * max(slow_rates)
    assert looked == 1


def test_rate_rises_then_falls_to_nothing():
    options = TrainOptions(steps=100, warmup=0.1, learning_rate=1.0)
    rates = [learning_rate(share / 100, options) for share in range(101)]
    assert rates[10] == 1.0
    assert all(a < b for a, b in zip(rates[:10], rates[1:11], strict=True))
    assert all(a > b for a, b in zip(rates[10:-1], rates[11:], strict=True))
    assert rates[-1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("both", [{}, {"steps": 3, "minutes": 1.0}])
def test_one_schedule_must_be_chosen(both):
    with pytest.raises(ValueError, match="exactly one above 0"):
        TrainOptions(**both)


def test_a_file_that_is_no_checkpoint_is_refused(tmp_path):
    path = tmp_path / CHECKPOINT_NAME
    path.write_bytes(b"no tensors here")
    with pytest.raises(ValueError, match="expected a safetensors file written by pgm-train"):
        load_checkpoint(path)


def test_batches_made_by_other_processes_give_the_same_losses(tmp_path):
    go(tmp_path / "here", steps=6)
    go(tmp_path / "there", steps=6, workers=1)
    assert losses(tmp_path / "here") == losses(tmp_path / "there")
