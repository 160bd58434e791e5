"""`livedrive devices`: the microphones and cameras that are here, and what to type for each."""

from dataclasses import dataclass


@dataclass(kw_only=True)
class Devices:
    """List microphones and eye cameras, and what else can be connected."""

    network: bool = False
    """Also ask the local network for eye cameras (OpenIris, over Wi-Fi): takes 3 s."""

    def run(self) -> None:
        from rich.table import Table

        from app.sinks import table as programs
        from app.terminal.console import console
        from sensors.audio.portaudio import microphones, silence_native_messages
        from sensors.cameras import table as cameras
        from sensors.cameras.discovery import found_devices
        from sensors.cameras.mdns import network_cameras
        from sensors.head import spec as heads
        from sensors.types import InputError

        silence_native_messages()
        table = Table()
        table.add_column("type this", no_wrap=True)
        for heading in ("name", "rate", "likely headset"):
            table.add_column(heading)
        notes: list[str] = []
        try:
            for mic in microphones():
                name = "the system's default" if mic.default else "microphone"
                rate = f"{mic.rate / 1000:g} kHz, {mic.channels} ch"
                table.add_row(f"--mic {quoted(mic.name)}", name, rate, "")
        except InputError as error:
            notes.append(str(error))
        nearby = network_cameras() if self.network else ()
        for found in (*found_devices(), *nearby):
            table.add_row(f"--eyes {found.spec}", found.name, found.detail, found.headset)
            if found.problem:
                notes.append(f"{found.spec}: {found.problem}")
        if table.row_count:
            console().print(table)
        else:
            print("no microphone and no camera found; plug one in, or see: livedrive doctor")
        for note in notes:
            print(f"note: {note}")
        print("not listed, but possible:")
        tables = {"eyes": cameras.SCHEMES, "head": heads.SCHEMES, "send": programs.SCHEMES}
        for option, schemes in tables.items():
            for entry in schemes.values():
                print(f"  --{option} {entry.example}  {entry.help}")


def quoted(name: str) -> str:
    import shlex

    return shlex.quote(name)
