"""
Validation: how many knots, which degree, which rank?
=====================================================

Section 2.4 of the paper: validation data choose the hyperparameters, and separate data grade the result. Splines
are the features (knots, degree). Principal component regression gives their weights (practical rank r).
``GridSearchCV`` tries all combinations. Generalised cross-validation needs one fit for all ranks.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.model_selection import GridSearchCV, KFold, train_test_split
from sklearn.pipeline import Pipeline

from sksurrogate.features import SplineFeatures
from sksurrogate.linear import PCRRegressor

plt.style.use("tableau-colorblind10")
rng = np.random.default_rng(1)


def truth(x):
    """A bump on a slope."""
    return 0.5 * x + np.exp(-((x - 1.2) ** 2) / 0.3)


x = rng.uniform(-3, 3, size=220)
y = truth(x) + 0.2 * rng.normal(size=220)
x_train, x_grade, y_train, y_grade = train_test_split(x[:, None], y, test_size=60, random_state=0)

pipeline = Pipeline([("splines", SplineFeatures()), ("pcr", PCRRegressor())])
grid = {
    "splines__n_knots": [4, 8, 16, 32],
    "splines__degree": [0, 1, 3],
    "pcr__n_components": [1, 2, 4, 6, 8, 10, 12, 16, 24, 32],
}
search = GridSearchCV(pipeline, grid, cv=KFold(5, shuffle=True, random_state=0), scoring="neg_root_mean_squared_error")
search.fit(x_train, y_train)
best = search.best_params_
grade = float(np.sqrt(np.mean((search.predict(x_grade) - y_grade) ** 2)))
print(f"chosen: {best}")
print(f"root mean squared error: validation {-search.best_score_:.3f}, grading {grade:.3f}; the noise is 0.200")

# %%
# Left: the chosen model. Right: the validation error over the rank for each number of knots, at the chosen degree. It falls to
# a minimum and rises again.

gcv = PCRRegressor("gcv", features=SplineFeatures(best["splines__n_knots"], best["splines__degree"])).fit(
    x_train, y_train
)
print(f"generalised cross-validation chooses rank {gcv.n_components_} for these splines")
found = search.cv_results_
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
line = np.linspace(-3, 3, 400)
left.plot(x_train, y_train, ".", color="0.7", label="training and validation")
left.plot(x_grade, y_grade, ".", color="C1", label="grading")
left.plot(line, truth(line), "k--", lw=1.5, label="truth")
left.plot(line, search.predict(line[:, None]), "C0", label="chosen model")
left.set(xlabel="x", ylabel="y", title=f"{best['splines__n_knots']} knots, degree {best['splines__degree']}")
left.legend()
for n_knots in grid["splines__n_knots"]:
    row = (found["param_splines__n_knots"] == n_knots) & (found["param_splines__degree"] == best["splines__degree"])
    ranks, error = found["param_pcr__n_components"][row].astype(int), -found["mean_test_score"][row]
    real = ranks <= n_knots + best["splines__degree"] - 1  # a larger rank means all
    right.plot(ranks[real], error[real], "o-", label=f"{n_knots} knots")
right.plot(np.sqrt(gcv.gcv_scores_), "k--", label="generalised cross-validation")
right.axhline(0.2, color="k", ls=":", lw=1, label="noise")
right.set(xlabel="practical rank r", ylabel="root mean squared error", title="Validation", ylim=(0.15, 0.5))
right.legend()
plt.show()
