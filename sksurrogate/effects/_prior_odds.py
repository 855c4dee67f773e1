"""How probable an effect is before any data: common effects before special ones, natural drivers before any other signal."""

from __future__ import annotations

from collections.abc import Collection
from typing import ClassVar

#: How many times less probable a law is that is driven by a signal other than those its form is known for.
FOREIGN_DRIVER = 10.0


class PriorOdds:
    """Prior odds of an effect against a friction, a gain or an offset."""

    kind: ClassVar[str]
    location: str | None
    variable: str | None
    #: How many times less probable than these: 10 for an effect with a state or a clock of its own, or a product of
    #: signals
    rarity: ClassVar[float] = 1.0
    #: Variables that the form is known for: "own" (the state of the location), "position" (a state that is the
    #: integral of another), "other" (any)
    natural_drivers: ClassVar[tuple[str, ...]] = ("own", "position", "other")

    def prior_weight(self, positions: Collection[str] = ()) -> float:
        """``1 / rarity``, divided by :data:`FOREIGN_DRIVER` where the variable is not natural to the form.

        Parameters
        ----------
        positions : collection of str
            States that are integrals of others.

        Examples
        --------
        >>> from sksurrogate.effects import CATALOGUE
        >>> drag = CATALOGUE["quadratic_drag"]
        >>> drag("speed", "speed").prior_weight(), drag("speed", "flow").prior_weight()
        (1.0, 0.1)
        """
        natural, v = self.natural_drivers, self.variable
        known = (
            self.kind != "state"
            or v is None
            or "other" in natural
            or ("own" in natural and v == self.location)
            or ("position" in natural and v in positions)
        )
        return 1.0 / (self.rarity * (1.0 if known else FOREIGN_DRIVER))
