"""A camera that announces itself is found, with the port of its pictures."""

import socket
import threading

import pytest
from zeroconf import DNSOutgoing, DNSPointer, IPVersion, ServiceInfo, Zeroconf

from sensors.cameras.mdns import SERVICE, network_cameras

HERE = "127.0.0.1"


def announced(name: str, properties: dict[str, str]) -> ServiceInfo:
    return ServiceInfo(
        SERVICE,
        f"{name}.{SERVICE}",
        addresses=[socket.inet_aton("10.1.2.3")],
        port=80,
        properties=properties,
        server=f"{name}.local.",
    )


@pytest.mark.slow
def test_what_announces_itself_is_found() -> None:
    camera = Zeroconf(interfaces=[HERE], ip_version=IPVersion.V4Only)
    stray = DNSOutgoing(0x8400)  # an answer; red before: a name that is no camera's ended all
    stray.add_answer_at_time(DNSPointer(SERVICE, 12, 1, 120, "evil._http._tcp.local."), 0)
    threads = threading.active_count()
    try:
        camera.register_service(announced("left", {"stream_port": "81"}))
        threading.Timer(0.3, camera.send, [stray]).start()
        camera.register_service(announced("right", {"stream_port": "nonsense"}))
        found = {d.name: d.spec for d in network_cameras(1.5, [HERE])}
    finally:
        camera.close()
    assert found == {"left": "http://10.1.2.3:81/", "right": "http://10.1.2.3:80/"}
    assert list(network_cameras(0.2, [HERE])) == []
    assert threading.active_count() <= threads  # red before: each question left one
