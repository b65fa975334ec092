import numpy as np

from prooflight.kernels.prediction.look_up import NODE_STEP, NODES
from prooflight.prediction.tables import node_fractions
from prooflight.press.artefact import Press


def test_nodes_lie_at_whole_byte_values_from_no_ink_to_just_beyond_full_ink() -> None:
    np.testing.assert_allclose(node_fractions() * 255, np.arange(NODES) * NODE_STEP, atol=1e-12)
    assert (NODES - 1) * NODE_STEP == 256


def test_both_tables_side_by_side_in_the_same_order(press: Press) -> None:
    sensor = press.sensors[0]
    both = sensor.interleaved()
    assert both.dtype == np.float32
    assert both.flags.c_contiguous
    np.testing.assert_array_equal(both[:, 0].reshape(sensor.mean_dn.shape), sensor.mean_dn)
    np.testing.assert_array_equal(both[:, 1].reshape(sensor.mean_dn.shape), sensor.variance_dn2)


def test_white_is_the_table_without_ink(press: Press) -> None:
    sensor = press.sensors[0]
    assert sensor.white_dn == sensor.mean_dn[0, 0, 0, 0] == sensor.mean_dn.max()
