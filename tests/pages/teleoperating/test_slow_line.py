"""The slow line between browser and server, by which latency is measured, loses and swaps nothing."""

from __future__ import annotations

import os
import socket
import threading

from benchmarks.page.slow_line import SlowLine


def test_every_byte_arrives_in_its_place_however_much_the_line_jitters():
    sent = os.urandom(200_000)
    with socket.create_server(("127.0.0.1", 0)) as listener, SlowLine(1, jitter_ms=10) as line:
        line.lead_to(listener.getsockname()[1])
        arrived = bytearray()

        def receive() -> None:
            there, _ = listener.accept()
            with there:
                while data := there.recv(2**16):
                    arrived.extend(data)

        receiving = threading.Thread(target=receive)
        receiving.start()
        with socket.create_connection(("127.0.0.1", line.port)) as here:
            here.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for start in range(0, len(sent), 1000):
                here.sendall(sent[start : start + 1000])
        receiving.join(30)
    assert bytes(arrived) == sent
