"""The face for other programs: VMC, VRChat, Live Link, JSON over WebSocket."""
