"""How often names that the evidence is certain of act: the log odds in ``gap/decide/_calibration.py``, and their error on plants left out.

    python docs/_scripts/calibration.py

``docs/calibration_names.csv`` has one row a name of evidence 0.9 and more: where it is from (cases of the blind check, plants with effects in
nature's form, or recordings, the last two judged by a reader), its plant, the lawful rest over the tolerance, the share of the gap that it closes,
and whether it, or one of its class, acts.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GroupKFold, cross_val_predict

from sksurrogate.blind._pictures import reliability
from sksurrogate.blind._probabilities import calibration_error
from sksurrogate.gap.decide._calibration import ratios

NAMES = Path(__file__).parents[1] / "calibration_names.csv"
TOLERANCE = 0.1
FOLDS = 12


def read():
    """Ratios (n_names, 2), whether each acts, its plant, and whether it has nature's form."""
    with NAMES.open(newline="") as file:
        rows = list(csv.DictReader(file))
    rest, share = (np.array([float(row[key]) for row in rows]) for key in ("rest", "share"))
    acts = np.array([row["acts"] == "1" for row in rows])
    plants = np.array([row["plant"] for row in rows])
    return (
        np.column_stack(ratios(TOLERANCE * rest, share, TOLERANCE)),
        acts,
        plants,
        np.array([row["source"] != "blind check" for row in rows]),
    )


def fitted():
    """Log odds beside no rest, and what each ratio takes from them."""
    X, acts, _, _ = read()
    model = LogisticRegression(C=100.0).fit(X, acts)
    return float(model.intercept_[0]), *(-model.coef_[0]).tolist()


def main():
    """Print the log odds, and stated against true shares on plants that were left out of the fit; draw these."""
    X, acts, plants, nature = read()
    print("log odds {:.2f}, less {:.2f} a tolerance of rest, less {:.2f} a tolerance over the part".format(*fitted()))
    folds = GroupKFold(FOLDS)
    stated = cross_val_predict(LogisticRegression(C=100.0), X, acts, groups=plants, cv=folds, method="predict_proba")[
        :, 1
    ]
    for what, chosen in (("all", np.ones(len(acts), bool)), ("blind check", ~nature), ("nature's forms", nature)):
        before, after = (
            calibration_error(list(zip(values[chosen], acts[chosen]))) for values in (np.ones(len(acts)), stated)
        )
        print(
            f"{what}: {chosen.sum()} names, error {before[0]:.3f} as certain, {after[0]:.3f} stated [{after[1]:.3f}, {after[2]:.3f}]"
        )
    for low, high in ((0.0, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 0.95), (0.95, 1.0)):
        some = (stated >= low) & (stated < high)
        print(f"{low:g} to {high:g}: {some.sum()} names, stated {stated[some].mean():.3f}, act {acts[some].mean():.3f}")
    reliability(list(zip(stated, acts))).savefig(NAMES.parent / "_static" / "calibration.png", dpi=100)


if __name__ == "__main__":
    main()
