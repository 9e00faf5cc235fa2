"""English sentences about studies, the demo, and the laboratory's libraries."""

TEMPLATES: dict[str, str] = {
    "study.recordings-missing": (
        "Recordings are missing: {folders} do not contain {recordings}. They are not part of baqueano; set "
        "BAQUEANO_DATA to the folder that contains {first}"
    ),
    "study.not-a-third": (
        "{subject} is the best with a known pose: its error is {ratio:.2f} times that of {reference} "
        "(95 % interval: up to {high:.2f}). Expected a third or less."
    ),
    "study.no-interval": (
        "{robots} robots are too few for an interval, so no controller is evaluated. Give more --seeds."
    ),
    "study.gain-at-bound": "{subject}: the search ended at a bound of {gains}",
    "study.stopped": "{subject}: {count} drives were stopped",
    "study.fits-refused": "the fits of these robots were refused: {robots}",
    "demo.experiment": "1/6 experiment  60 s of random steps",
    "demo.identify": "2/6 identify    the model from commands and IMU",
    "demo.noise": "3/6 noise       covariances of sensors and model",
    "demo.tune": "4/6 tune        gains on the identified model",
    "demo.teach": "5/6 teach       a sinuous circle",
    "demo.repeat": "6/6 repeat      {laps} laps",
    "demo.refused": "The fit of the demo was refused: {cause}",
}
