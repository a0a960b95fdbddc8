"""The tables of the solution: range, method and steps."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from ..tables.table import (
    LARGEST_NUMBER,
    Frequency,
    NotNegative,
    Positive,
    Table,
    each_above_the_one_before,
    no_duplicates,
    rising,
)

DEFAULT_ACCURACY = 1e-2  # for a scene without harmonics and accuracy
ACCURACY_OF_MODES = 1e-3  # for a scene with harmonics and without accuracy
DEFAULT_INTERFACE_MODES = 40  # or all modes of the joint, if fewer

Harmonic = Annotated[int, Field(ge=0, le=10_000)]
Method = Literal[
    "adaptive", "adaptive-energy", "receptance", "full", "craig-bampton", "rubin", "joint-interface-modes", "trial-vectors"
]


class Over(Table):
    """[[response.over]]: a parameter over which the peaks of an output are followed."""

    key: str = Field(description='"level", "damping.ratio", "damping", or a number of a joint as "joints.NAME.friction"')
    range: tuple[NotNegative, NotNegative] = Field(description="two numbers of at least 0: begin and end of the curve")
    at: Annotated[tuple[NotNegative, ...], AfterValidator(no_duplicates)] = Field(
        (), description="a list of values within the range, each once, that become points of the curve"
    )
    output: str | None = Field(None, description="the name of an output; the first one if left out")
    level: Positive | None = Field(
        None, description="the level in N, if key is another parameter; the highest of levels if left out"
    )

    @model_validator(mode="after")
    def _within(self):
        low, high = sorted(self.range)
        if low == high:
            raise ValueError("range has the same number twice; a curve needs two ends")
        if self.key == "level" and self.level is not None:
            raise ValueError("level is the varied parameter; leave the key level out")
        if low == 0.0 and (self.key in ("level", "damping", "damping.ratio") or self.key.endswith("stiffness")):
            raise ValueError("range begins or ends at 0, where nothing moves or holds; state a number above 0")
        for value in self.at:
            if not low <= value <= high:
                raise ValueError(
                    f"at holds {value:g}, outside range = [{self.range[0]:g}, {self.range[1]:g}]; choose one there, or widen it"
                )
        return self

    @property
    def of_joint(self) -> tuple[str, str] | None:
        """The names of the joint and of its parameter; None if the level or another key varies."""
        parts = self.key.split(".")
        is_of_joint = len(parts) >= 3 and parts[0] == "joints"
        return (".".join(parts[1:-1]), parts[-1]) if is_of_joint else None


class Response(Table):
    """[response]: levels and frequencies of the curves."""

    levels: Annotated[tuple[Annotated[Positive, Field(le=1e100)], ...], AfterValidator(no_duplicates)] = Field(
        min_length=1, description="a list of load levels in N, numbers above 0 and at most 1e100, each once"
    )
    frequencies: Annotated[tuple[Frequency, Frequency], AfterValidator(rising)] | None = Field(
        None, description="two frequencies in Hz, above 0 and at most 1e9, the lower one first"
    )
    mode: int | None = Field(None, ge=1, description="the number of a mode, a whole number of at least 1")
    span: Annotated[tuple[Positive, Positive], AfterValidator(rising)] | None = Field(
        None, description="two factors of the mode's frequency, above 0, the lower one first"
    )
    points: int = Field(100, ge=2, le=10_000_000, description="the number of points per level, a whole number of at least 2")
    at: Annotated[tuple[Frequency, ...], AfterValidator(no_duplicates)] = Field(
        (), description="a list of frequencies in Hz, above 0, each once"
    )
    direction: Literal["up", "down"] = Field("up", description='the direction of the sweep, "up" or "down"')
    peaks: bool = Field(False, description="true or false: solve for every maximum of every output as a separate point")
    stability: bool = Field(False, description="true or false: compute the stability of every point by Floquet multipliers")
    sensitivities: bool = Field(
        False, description="true or false: compute derivatives of the outputs by contact parameters, level and damping"
    )
    over: tuple[Over, ...] = Field((), description="tables headed [[response.over]], with key and range")
    fields: bool = Field(True, description="true or false: write modes and the motion at the peaks on the mesh")

    @model_validator(mode="after")
    def _range(self):
        if self.exactly_one("frequencies", "mode") == "mode" and self.span is None:
            raise ValueError("span is missing: with mode, expected " + str(Response.model_fields["span"].description))
        if self.frequencies is None:
            return self
        if self.span is not None:
            raise ValueError("span belongs to mode; it has no meaning with frequencies")
        low, high = self.frequencies
        for frequency in self.at:
            if not low <= frequency <= high:
                raise ValueError(
                    f"at holds {frequency:g} Hz, outside frequencies = [{low:g}, {high:g}]; choose one there, or widen the range"
                )
        return self


class Solver(Table):
    """[solver]: the method and its accuracy."""

    method: Method = Field("receptance", description="a method's name")
    accuracy: float | None = Field(
        None, gt=0, lt=1, description="the accepted error of the response relative to its peak, a number above 0 and below 1"
    )
    accuracy_of: Literal["amplitude", "corrected"] = Field(
        "amplitude", description='"amplitude": accuracy applies to the solution; "corrected": to the corrected amplitude'
    )
    modes: int | None = Field(None, ge=1, le=LARGEST_NUMBER, description="the number of modes, a whole number of at least 1")
    harmonics: Harmonic | Annotated[tuple[Harmonic, ...], AfterValidator(each_above_the_one_before)] = Field(
        3, description="the highest harmonic, a whole number of at least 0, or an ascending list of harmonics that includes 1"
    )
    samples: int = Field(128, ge=1, le=10_000_000, description="the time samples per period, a whole number above 2 x harmonics")
    between_samples: Literal["path", "return-map"] = Field(
        "path",
        description='"path": the contact law follows the motion between samples; "return-map": it is evaluated at samples only',
    )
    energy_tolerance: NotNegative = Field(1e-10, description="the energy in J per cycle and pair, a number of at least 0")
    tolerance: float = Field(1e-8, gt=0, lt=1, description="the relative tolerance of a point, a number above 0 and below 1")
    condensed: bool = Field(False, description="true or false: rubin with relative interface DOFs only")
    interface_modes: int = Field(
        DEFAULT_INTERFACE_MODES, ge=1, le=LARGEST_NUMBER, description="the shapes of the joint, a whole number of at least 1"
    )
    in_point_check: bool = Field(False, description="true or false: check all pairs within the solution of a point")
    error_bars: bool = Field(True, description="true or false: estimate the error of every point")
    verify_modes: bool = Field(True, description="true or false: prove by the inertia that no mode is missed")

    @model_validator(mode="after")
    def _sampled(self):
        H = max(self.chosen)
        if self.samples <= 2 * H:
            raise ValueError(
                f"samples = {self.samples} do not resolve harmonics = {H}; "
                f"at least {2 * H + 1} are needed, {max(128, 16 * H)} are advised"
            )
        if isinstance(self.harmonics, tuple) and 1 not in self.harmonics:
            raise ValueError(f"harmonics = {list(self.harmonics)} has no harmonic 1, which defines the amplitude of responses")
        return self

    @property
    def chosen(self) -> tuple[int, ...]:
        """The stated harmonics: a list, or 0 to the highest."""
        return self.harmonics if isinstance(self.harmonics, tuple) else tuple(range(self.harmonics + 1))


class Continuation(Table):
    """[continuation]: step lengths along the curve; omitted ones follow from [response] points."""

    ds: Positive | None = Field(None, le=1, description="the first step as a fraction of the curve, above 0 and at most 1")
    ds_min: Positive | None = Field(None, le=1, description="the shortest step as a fraction of the curve, above 0 and at most 1")
    ds_max: Positive | None = Field(None, le=1, description="the longest step as a fraction of the curve, above 0 and at most 1")

    @model_validator(mode="after")
    def _ordered(self):
        given = [(key, getattr(self, key)) for key in ("ds_min", "ds", "ds_max") if getattr(self, key) is not None]
        for (lower, small), (upper, large) in pairwise(given):
            if small > large:
                raise ValueError(f"{lower} = {small:g} is above {upper} = {large:g}; ds_min <= ds <= ds_max is needed")
        return self
