"""Training goes on from the packaged file: what is written can be read back, weight by weight."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("onnx")


@pytest.mark.filterwarnings("ignore")  # torch's other exporter writes no named normalisations
def test_a_written_network_is_read_back_and_gives_the_same(tmp_path):
    from companion.perception.eyes import Eyes
    from training.network import Network, export, load

    torch.manual_seed(1)
    network = Network()
    with torch.no_grad():
        for value in network.state_dict().values():
            if value.is_floating_point():
                value.add_(0.02 * torch.rand_like(value))
    file = tmp_path / "network.onnx"
    export(network, str(file), 640, 400)
    again = Network()
    again.load_state_dict(load(str(file)), strict=False)
    picture = torch.rand(1, 3, 400, 640)
    for a, b in zip(network.eval()(picture), again.eval()(picture), strict=True):
        assert torch.equal(a, b)
    look = Eyes(file).look(np.full((400, 640, 3), 90, np.uint8))
    assert look.drones.shape == (5, 50, 80)


def test_the_packaged_network_can_be_trained_on():
    from companion.perception.eyes import PACKAGED
    from training.network import Network, load

    weights = load(str(PACKAGED))
    missing, unexpected = Network().load_state_dict(weights, strict=False)
    assert not unexpected
    assert all("num_batches" in name for name in missing)
