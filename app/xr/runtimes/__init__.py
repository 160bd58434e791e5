"""OpenXR runtimes behind one protocol: real ones through pyopenxr, and a stand-in for tests."""
