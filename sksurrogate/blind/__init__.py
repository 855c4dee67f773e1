"""The check on withheld effects: how far can a diagnosis be trusted?"""

from sksurrogate.blind._campaign import run_blind_check, run_case
from sksurrogate.blind._cases import ARMS, Case, Question, draw
from sksurrogate.blind._plants import PLANTS, PlantSpec
from sksurrogate.blind._robot_arms import ROBOT_ARMS
from sksurrogate.blind._table import BlindResult

__all__ = [
    "ARMS",
    "PLANTS",
    "ROBOT_ARMS",
    "BlindResult",
    "Case",
    "PlantSpec",
    "Question",
    "draw",
    "run_blind_check",
    "run_case",
]
