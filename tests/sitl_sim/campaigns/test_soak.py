"""A soak of seconds: flights, collisions, and growth of memory and open files."""

from sitl_sim.campaigns.soak import SoakResult, growth, soak


def test_two_short_flights():
    results = list(soak(hours=20.0 / 3600.0, drones=1, minutes=10.0 / 60.0, seed=1))
    assert len(results) == 2
    assert all(p.collisions == 0 and p.rss_mb > 10 and p.files > 3 for p in results)


def test_growth_counts_from_the_second_flight():
    flights = [
        SoakResult(0.1 * n, 1, 0, 0, 2, mb, 9 + n) for n, mb in enumerate([100, 150, 151, 152])
    ]
    assert growth(flights) == (2, 2)
