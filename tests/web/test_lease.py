"""One driver at a time; its heartbeats count only if its picture is recent."""

import pytest
from hypothesis import given, strategies as st

from baqueano.errors import SafetyStop
from baqueano.web.lease import LEASE_S, Lease


class Clock:
    """A clock that the test sets."""

    s = 0.0

    def __call__(self) -> float:
        return self.s


def lease_of(name="ana"):
    clock = Clock()
    lease = Lease(clock)
    lease.acquire(name, name)
    return clock, lease


def test_rt13_a_lease_ends_300_ms_after_the_last_beat():
    clock, lease = lease_of()
    clock.s = 0.2
    assert lease.renew("ana", 1, 0.0)
    clock.s = 0.2 + LEASE_S
    assert lease.holder == "ana"
    clock.s += 0.001
    assert lease.holder is None
    assert not lease.renew("ana", 2, 0.0)


def test_rt13_ne4_a_driver_with_a_frozen_picture_loses_the_lease():
    clock, lease = lease_of()
    for k in range(1, 11):
        clock.s = 0.05 * k
        lease.renew("ana", k, age_s=0.0 if k < 3 else clock.s)
    assert lease.holder == "ana"
    clock.s = 0.31 + LEASE_S
    assert lease.holder is None


def test_rt13_the_lease_accepts_an_older_picture_over_a_slow_connection():
    _, lease = lease_of()
    assert not lease.renew("ana", 1, age_s=0.4)
    assert lease.renew("ana", 2, age_s=0.4, round_trip_s=0.15)
    assert not lease.renew("ana", 3, age_s=float("nan"), round_trip_s=0.15)


def test_rt14_a_second_driver_is_refused_until_the_vehicle_is_handed_over():
    _, lease = lease_of()
    with pytest.raises(SafetyStop) as error:
        lease.acquire("luis", "luis")
    assert error.value.diagnostic.figures["name"] == "ana"
    with pytest.raises(SafetyStop):
        lease.pass_to("luis", "luis", "luis")
    lease.pass_to("ana", "luis", "luis")
    assert lease.holder == "luis"
    lease.pass_to("luis")
    lease.acquire("ana", "ana")
    assert not lease.on_disconnect("luis")
    assert lease.on_disconnect("ana")
    assert lease.holder is None


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["ana", "luis", "eva"]), st.sampled_from(["take", "give", "beat", "left"]),
            st.integers(-2, 12), st.sampled_from([0.0, 0.1, 0.5, float("inf")]), st.sampled_from([0.0, 0.05, 0.4]),
        )
    )
)  # fmt: skip
def test_rt14_ne4_commands_of_two_drivers_never_mix(words):
    clock = Clock()
    lease, counted_drivers = Lease(clock), []
    holder, last, n_last = None, float("-inf"), 0
    for driver, word, n, age, later in words:
        clock.s += later
        if holder is not None and clock.s > last + LEASE_S:
            holder = None
        if word == "take":
            if holder in (None, driver):
                lease.acquire(driver, driver)
                holder, last, n_last = driver, clock.s, 0
            else:
                with pytest.raises(SafetyStop):
                    lease.acquire(driver, driver)
        elif word == "beat":
            counts = holder == driver and n > n_last and age <= LEASE_S
            assert lease.renew(driver, n, age) == counts
            n_last = n if holder == driver and n > n_last else n_last
            last = clock.s if counts else last
            counted_drivers += [driver] if counts else []
        elif word == "left":
            lease.on_disconnect(driver)
            holder = None if holder == driver else holder
        elif holder == driver:
            lease.pass_to(driver)
            holder = None
        assert lease.holder == holder
