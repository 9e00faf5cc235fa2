"""English sentences of simulations, and of comparisons of runs."""

TEMPLATES: dict[str, str] = {
    "simulate.lost": "{lost} of {vehicles} vehicles left the finite numbers and are not counted",
    "simulate.clipped": "{clipped} of {vehicles} draws were brought back to a bound",
    "compare.inconsistent": "{subject} {how}",
}
