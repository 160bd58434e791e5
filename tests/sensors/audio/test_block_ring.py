"""BlockRing: nothing torn, nothing lost in silence."""

import sys
import threading

import numpy as np

from sensors.audio.block_ring import BlockRing


def test_blocks_come_out_whole_and_in_order_while_being_written() -> None:
    ring, num, got = BlockRing(8, 16, 2), 4000, []
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:

        def write() -> None:
            for k in range(num):
                ring.write(np.full((16, 2), k, np.float32), k, False)

        writer = threading.Thread(target=write)
        writer.start()
        while writer.is_alive():
            got += ring.read()
        writer.join()
        got += ring.read()
    finally:
        sys.setswitchinterval(before)
    for block in got:
        assert (block.samples == block.arrival_ns).all()
        assert block.first_sample == 16 * block.arrival_ns
    firsts = [b.first_sample for b in got]
    assert firsts == sorted(set(firsts))
    assert ring.dropped_samples + 16 * len(got) == 16 * num


def test_a_full_ring_counts_what_it_drops() -> None:
    ring = BlockRing(2, 4, 1)
    for k in range(5):
        ring.write(np.full((3, 1), k, np.float32), k, k == 1)
    assert [b.first_sample for b in ring.read()] == [0, 3]
    assert ring.dropped_samples == 9
    ring.write(np.zeros((4, 1), np.float32), 9, True)
    (block,) = ring.read()
    assert (block.first_sample, block.overflow, block.samples.shape) == (15, True, (4, 1))
