"""The results of Grella et al. 2023, on the real sensors, by split and model."""

from t2twin.translate.evaluation.records import PaperRow

PAPER: dict[str, dict[str, PaperRow]] = {
    "val": {
        "touch2touch": PaperRow(rmse_counts=4007, rmse_percent=10.01, ssim=0.96),
        "resnet18": PaperRow(rmse_counts=3931, rmse_percent=9.83, ssim=0.95),
    },
    "test": {
        "touch2touch": PaperRow(rmse_counts=6072, rmse_percent=15.18),
        "resnet18": PaperRow(rmse_counts=4867, rmse_percent=12.17),
    },
}
"""The paper gives the root of its L3 as the error, and one SSIM a model."""
