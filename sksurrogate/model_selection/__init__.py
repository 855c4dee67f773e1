"""Selection on the free run, splits that keep runs whole, intervals of free runs."""

from sksurrogate.model_selection._conformal import ConformalFreeRun
from sksurrogate.model_selection._orders import OrderScan, scan_orders
from sksurrogate.model_selection._remembered import Remembered
from sksurrogate.model_selection._scorer import FreeRunScorer
from sksurrogate.model_selection._splits import BlockedSplit, split_runs

__all__ = ["BlockedSplit", "ConformalFreeRun", "FreeRunScorer", "OrderScan", "Remembered", "scan_orders", "split_runs"]
