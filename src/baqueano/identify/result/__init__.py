"""From a finished search to a Fit."""
