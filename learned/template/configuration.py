"""Named configurations of the template: sizes of the fields, and what each term of the loss weighs."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any

from benchmark.api.contracts import Interval
from learned.described import configuration_named, described_by


@dataclass(frozen=True, kw_only=True)
class Template:
    """One template with its deformations, and what they are trained for.

    The weights are relative to that of the signed distance. They are those of the authors' implementation
    (github.com/microsoft/DIF-Net, loss.py), each divided by its 3000 for the distance, but for three. A code weighs
    less: by the authors' weight all codes are zero within a hundred steps where they choose gains and shifts instead of
    weights. A correction weighs nine times as much, for it is lost to a form, which only what is moved changes. The
    normals of the template weigh nothing, for chairs and cars do not bend.

    Parameters
    ----------
    name
        Name on the command line.
    bodies
        Bodies of the stream that are trained on, each in the canonical pose and in those that the stream gives it; each
        of these shapes has a code of its own.
    code_size
        Numbers that a shape is reduced to.
    width
        Units of each hidden layer of both fields, 128 in DIF-Net.
    template_layers, deformation_layers
        Hidden layers of each field, the first one included; both 4 in DIF-Net.
    template_frequency, deformation_frequency
        Factor inside of the sines, called omega_0 in [Sitzmann et al. 2020, SIREN, section 3.2]; 30 there. The
        deformation has less, for it is smooth and would otherwise begin with waves shorter than a limb is thick.
    rays
        Points on the surface, and as many around it, of each shape in each step.
    normal
        Weight of the angle between the gradient of the field and the normal of the surface.
    eikonal
        Weight of what the length of the gradient lacks to 1.
    template_normal
        Weight of the angle between the gradient of the template and the normal of the shape: what is deformed should
        not turn.
    smoothness
        Weight of the gradient of the deformation.
    correction
        Weight of the correction.
    code
        Weight of the mean square of a code.
    """

    name: str
    bodies: Annotated[int, Interval(1, 4096)] = 64
    code_size: Annotated[int, Interval(1, 1024)] = 128
    width: Annotated[int, Interval(8, 512)] = 128
    template_layers: Annotated[int, Interval(1, 8)] = 4
    deformation_layers: Annotated[int, Interval(1, 8)] = 4
    template_frequency: Annotated[float, Interval(0, closed="neither")] = 30.0
    deformation_frequency: Annotated[float, Interval(0, closed="neither")] = 5.0
    rays: Annotated[int, Interval(8, 4096)] = 128
    normal: Annotated[float, Interval(0)] = 1 / 30
    eikonal: Annotated[float, Interval(0)] = 1 / 60
    template_normal: Annotated[float, Interval(0)] = 0.0
    smoothness: Annotated[float, Interval(0)] = 1 / 600
    correction: Annotated[float, Interval(0)] = 0.3
    code: Annotated[float, Interval(0)] = 1e-3

    def described(self) -> dict[str, Any]:
        """All fields, for a card."""
        return asdict(self)


PLAIN = Template(name="plain")

TEMPLATES: dict[str, Template] = {
    each.name: each for each in (PLAIN, replace(PLAIN, name="authors", template_normal=1 / 30, correction=1 / 30))
}
"""All configurations by name; ``authors`` has the weights of DIF-Net but for that of a code."""


def template(name: str) -> Template:
    """Configuration of this name, or a ``ConfigurationError`` that names the nearest ones."""
    return configuration_named(name, TEMPLATES)


def from_card(described: object) -> Template:
    """Configuration that a card describes.

    Raises
    ------
    ConfigurationError
        If it is not one.
    """
    return described_by(described, PLAIN)
