"""English sentences of studies, of the demo, and of the laboratory's libraries."""

TEMPLATES: dict[str, str] = {
    "study.recordings-missing": (
        "recordings are missing: {folders} lack {missing}. They do not come with baqueano; set "
        "BAQUEANO_DATA to the folder that holds {first}"
    ),
    "demo.refused": "the fit of the demo was refused: {cause}",
}
