import numpy as np

from prooflight.kernels.prediction.lookup import NODE_STEP, NODES
from prooflight.prediction.tables import node_fractions
from prooflight.press.artefact import Press


def test_nodes_lie_at_whole_byte_values_from_no_ink_to_just_beyond_full_ink() -> None:
    np.testing.assert_allclose(node_fractions() * 255, np.arange(NODES) * NODE_STEP, atol=1e-12)
    assert (NODES - 1) * NODE_STEP == 256


def test_white_is_the_table_without_ink(press: Press) -> None:
    sensor = press.sensors[0]
    assert sensor.white_dn == sensor.mean_dn[0, 0, 0, 0] == sensor.mean_dn.max()
