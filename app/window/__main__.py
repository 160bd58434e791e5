"""The window process, started by WindowSink."""

from app.process import child
from app.window.state.shared import SharedMemory, WindowInfo
from sensors.types import InputError


def main() -> None:
    """Open the window; what goes wrong is left in the shared memory for the loop to report."""
    given = child.begin()
    memory = SharedMemory(given.memories[0])
    for name in ("avatars", "emotions"):
        given.info[name] = tuple(given.info[name])
    info = WindowInfo(**given.info)
    try:
        try:
            # Before any import of glfw: makes it load the library that ImGui uses.
            import imgui_bundle  # noqa: F401  # pyright: ignore[reportUnusedImport]
        except ImportError as error:
            raise InputError(
                f"--window: expected imgui-bundle, got {error}; run: pip install livedrive[window]"
            ) from error
        from app.window.screen import Screen
        from app.window.window import Window

        screen = Screen(f"livedrive - {info.title}")
        window = Window(screen, memory, info)
    except InputError as error:
        memory.controls["error"] = str(error).encode()[:400]
        raise SystemExit(2) from None
    window.run(given.parent_lives)


if __name__ == "__main__":
    main()
