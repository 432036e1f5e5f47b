"""The painter's passes: the same texels as without SIMD, and tiles that hold every ray."""

import numpy as np
import pytest

from sitl_sim.sensors.fisheye import Lens
from sitl_sim.sensors.looks import passes
from sitl_sim.sensors.looks.painter import tiled
from sitl_sim.sensors.looks.tiling import TILE_PX
from sitl_sim.sensors.tables import mip, texel
from sitl_sim.sensors.textures import LEVELS, TILE


def test_a_mip_level_by_bits_is_that_by_halving():
    edges = 1.5 * 2.0 ** np.arange(-3, LEVELS + 2)
    near = np.concatenate([np.nextafter(edges, 0), edges, np.nextafter(edges, np.inf), [0.0, 1e9]])
    drawn = np.exp(np.random.default_rng(0).uniform(-5, 8, 2000))
    for footprint in np.concatenate([near, drawn]).astype(np.float32):
        by_bits = passes._mip(footprint.view(np.int32))
        assert by_bits == mip(footprint), footprint


@pytest.mark.parametrize("level", range(LEVELS))
def test_a_texel_without_a_table_is_that_with_it(level):
    rng = np.random.default_rng(level)
    for u, v in rng.integers(0, 10 * TILE, (200, 2)).astype(np.int32):
        assert passes._texel(u, v, np.int32(level)) == texel(u, v, np.int32(level))


@pytest.mark.parametrize(("width", "height"), [(64, 48), (50, 30)])
def test_tiles_hold_each_ray_once_and_repeat_the_edge(width, height):
    rays = Lens(width, height).rays
    tiles = tiled(rays)
    across, down = -(-width // TILE_PX), -(-height // TILE_PX)
    assert tiles.shape == (across * down, 3, TILE_PX**2)
    for y, x in np.ndindex(down * TILE_PX, across * TILE_PX):
        tile = tiles[y // TILE_PX * across + x // TILE_PX]
        place = y % TILE_PX * TILE_PX + x % TILE_PX
        assert (tile[:, place] == rays[:, min(y, height - 1), min(x, width - 1)]).all()
