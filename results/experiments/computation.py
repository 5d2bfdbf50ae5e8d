"""How much computation the networks take, beside what the paper's days on its card could do; prints
the table.

    python results/experiments/computation.py

A forward pass is counted by torch's counter of floating-point operations, on tensors without
content. A training step costs three forward passes: one forward, and two backward, for the
gradients of activations and of weights. Pointwise operations are not counted.
"""

from __future__ import annotations

import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmark.report.formats import markdown_table
from learned.models import CONFIGURATIONS

#: Passes that a training step costs, in forward passes.
PASSES = 3

#: Pairs of images in a training of Table I: ten subjects in twenty poses.
PAIRS = 200

#: Networks: configuration, pixels of a side, and epochs.
NETWORKS = (("as_printed", 500, 500), ("literal", 128, 60))

#: Days that the paper reports, and the largest rate of its card, an RTX 4090, in TFLOP a second:
#: single precision without tensor cores, and bfloat16 on tensor cores (NVIDIA's data sheet).
DAYS = 3
RATES = {"single precision": 82.6, "bfloat16": 165.2}

#: Share of the largest rate that a training of convolutions reaches at least, and at most.
SHARES = (0.1, 0.5)

TERA = 1e12


def forward_operations(configuration: str, pixels: int) -> float:
    """Return the floating-point operations of a forward pass of one image; a multiply-add counts
    two.
    """
    with torch.device("meta"):
        network = CONFIGURATIONS[configuration].build()
        image = torch.zeros(1, 1, pixels, pixels)
        with FlopCounterMode(display=False) as counter, torch.no_grad():
            network(image)
    return float(counter.get_total_flops())


def parameters(configuration: str) -> int:
    """Return the number of weights of a network."""
    with torch.device("meta"):
        network = CONFIGURATIONS[configuration].build()
    return sum(weight.numel() for weight in network.parameters())


def training(configuration: str, pixels: int, epochs: int) -> float:
    """Return the TFLOP of a training."""
    return PASSES * forward_operations(configuration, pixels) * PAIRS * epochs / TERA


def capacity(rate: float, share: float) -> float:
    """Return the TFLOP that the paper's days hold at a share of a rate."""
    return DAYS * 24 * 3600 * rate * share


def main() -> None:
    """Print the table, and how many times as much computation the paper's days hold."""
    body = []
    for configuration, pixels, epochs in NETWORKS:
        operations = forward_operations(configuration, pixels)
        width = CONFIGURATIONS[configuration].width
        body.append(
            [
                f"here, {pixels} px, width {width}, {epochs} epochs",
                f"{parameters(configuration):,}",
                f"{operations / 2 / 1e9:.1f}",
                f"{training(configuration, pixels, epochs):,.0f}",
            ]
        )
    for name, rate in RATES.items():
        low, high = (capacity(rate, share) for share in SHARES)
        body.append(
            [f"{DAYS} days of the paper's card, {name}", "", "", f"{low:.1e} to {high:.1e}"]
        )
    print(
        "\n".join(
            markdown_table(["", "parameters", "GMAC a forward pass", "TFLOP a training"], body)
        )
    )
    least = capacity(RATES["single precision"], SHARES[0]) / training(*NETWORKS[0])
    most = capacity(RATES["bfloat16"], SHARES[1]) / training(*NETWORKS[0])
    print(f"\nThe paper's days hold {least:,.0f} to {most:,.0f} times the training at 500 pixels.")


if __name__ == "__main__":
    main()
