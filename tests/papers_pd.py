"""A vehicle file of the garage with the PD controller of the paper, for the tests of this controller."""

from baqueano.vehicle_file import VehicleFile, load, parse


def with_papers_pd(name: str = "small", gains: str = "alpha = 30.0\nbeta = 2.0\ngamma = 0.3") -> VehicleFile:
    """Return the file `name` with [controller] kind = "pd" and these gains."""
    text = load(name).text
    assert 'kind = "pd_feedforward"' in text
    return parse(text.replace('kind = "pd_feedforward"', f'kind = "pd"\n{gains}'), f"{name}.toml")
