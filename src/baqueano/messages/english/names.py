"""English sentences of names that nobody knows: what was probably meant, and which there are."""

TEMPLATES: dict[str, str] = {
    "name.near": "Did you mean {meant}? Known are {known}",
    "name.unknown": "Known are {known}",
}
