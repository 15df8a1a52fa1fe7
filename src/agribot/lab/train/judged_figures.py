"""Names of the figures, in a training's log, of what is judged on pictures set aside."""

MIOU, STEM_F1, BALANCED = "valid_miou", "valid_stem_f1", "valid_balanced"
FIGURES = (MIOU, STEM_F1, BALANCED)
