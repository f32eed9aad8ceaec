# Needs Python 3.10 to 3.13, git and make; everything else goes into .venv, once.

PYTHONS := python3 python3.13 python3.12 python3.11 python3.10 python
VENV := .venv
INSTALLED := $(VENV)/.installed
DOCS_INSTALLED := $(VENV)/.docs_installed
PY := $(VENV)/bin/python
BY_FILE := --dist loadfile --no-loadscope-reorder # in the order of test/conftest.py

# The wheels in .venv are a ROS 2 of their own: one sourced in this shell (or another .venv) must not shine through.
unexport PYTHONHOME PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH RMW_IMPLEMENTATION _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport PYTHONDONTWRITEBYTECODE # each of the many processes would compile the package again, 0.2 s
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help install demo test thorough test-fast check faults soak fuzz lies lint bench docs clean
.DELETE_ON_ERROR:

help:
	@echo "make demo    replay the recorded flight through the live nodes, show the result and its error; RATE=0.1: slower"
	@echo "make check   while one works: lint, type check, and the tests that are quick"
	@echo "make test    lint, type check and all tests but those of make faults and make thorough"
	@echo "make thorough  the tests that take longest: the contract of rare methods, long flights"
	@echo "make faults  what must be survived: killed nodes, full disks, hostile bytes, cut links (as root, all of it)"
	@echo "make soak    an hour of 1080p at 25 frames/s: memory, latency, and every frame accounted for"
	@echo "make fuzz    a million damaged inputs for every reader"
	@echo "make lies    random flights with known motion: where the tracker is wrong; FLIGHTS=100 SEED=1 JOBS=2"
	@echo "make lint    lint and type check alone; make test-fast: the quick tests alone"
	@echo "make bench   time a frame, step by step"
	@echo "make docs    build the docs site into site/, every link and anchor checked"
	@echo "make install set up .venv (the others do it when needed)"
	@echo "make clean   remove .venv and what the tools left"

install: $(INSTALLED)

demo: $(INSTALLED)
	@$(PY) -m stab_ros.demo $(if $(RATE),--rate '$(RATE)')

test: export ROS_PYTHON_CHECK_FIELDS := 1
test: lint
	$(PY) -m pytest -n 3 $(BY_FILE) --ignore test/faults -m "not thorough"

thorough: $(INSTALLED)
	$(PY) -m pytest -n 2 --dist load --ignore test/faults -m thorough

check: lint test-fast

test-fast: $(INSTALLED)
	$(PY) -m pytest -n 2 $(BY_FILE) --ignore test/faults -m "not (dds or big or slow or thorough)" -q

faults: export ROS_PYTHON_CHECK_FIELDS := 1
faults: $(INSTALLED)
	$(PY) -m pytest -n 2 $(BY_FILE) test/faults

soak: $(INSTALLED)
	@$(PY) bench/soak.py

fuzz: $(INSTALLED)
	@$(PY) test/faults/fuzz.py --inputs 1000000

lies: $(INSTALLED)
	@$(PY) bench/lies/run.py --flights '$(or $(FLIGHTS),100)' --first '$(or $(SEED),1)' --jobs '$(or $(JOBS),2)'

lint: $(INSTALLED)
	$(PY) -m ruff check .
	$(PY) -m mypy

bench: $(INSTALLED)
	@$(PY) bench/run.py

docs: export NO_MKDOCS_2_WARNING := 1
docs: $(DOCS_INSTALLED)
	@$(PY) docs/make_site.py

$(DOCS_INSTALLED): $(INSTALLED)
	@$(PY) -m pip install --quiet --editable '.[docs]' && touch $@

clean:
	rm -rf $(VENV) build install log demo_output site stab_ros.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The first Python of PYTHONS that runs, is of the right version and can make an environment; PYTHONS=... overrides.
define FIND_PYTHON
for python in $(PYTHONS); do \
    "$$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' 2>/dev/null || continue; \
    "$$python" -c 'import ensurepip, venv' 2>/dev/null && found="$$python" && break; \
    incomplete="$$python"; \
done; \
if [ -z "$$found" ] && [ -n "$$incomplete" ]; then \
    echo "$$incomplete has no venv or no ensurepip; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; \
elif [ -z "$$found" ]; then \
    echo "no Python 3.10 to 3.13 among $(PYTHONS); name one: make PYTHONS=/path/to/python3.12" >&2; exit 1; \
fi
endef

$(INSTALLED): setup.py
	@started_s=$$(date +%s); \
	$(FIND_PYTHON); \
	$(PY) -m pip --version >/dev/null 2>&1 || "$$found" -m venv --clear $(VENV) || exit; \
	echo "install   $(VENV) with $$($(PY) --version); the first time this fetches about 280 MB ..."; \
	$(PY) -m pip install --editable '.[test]' && $(VENV)/bin/stab-ros warm-up && touch $@ && \
	echo "install   done, with the inner loops compiled  $$(($$(date +%s) - started_s)) s"
