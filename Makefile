# Every command a newcomer or a developer needs. `make bench` and `make test` set up everything by themselves.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip install --quiet
READY  := $(VENV)/.ready
# What makes the documentation site, on top of these.
DOCUMENTED := $(VENV)/.documented
# What runs need; the tools of developers come on top.
RUNNABLE := $(VENV)/.runnable
# Kernels are compiled again where a file of them is newer.
COMPILED := $(VENV)/.compiled
# Those of a quick run alone, in half the time.
QUICK := $(VENV)/.compiled-quick
KERNELS := $(shell grep -rl njit --include='*.py' baselines benchmark learned retrieval)

# Where modules are not kept compiled, each of some hundred processes compiles numpy, scipy and torch for itself.
unexport PYTHONDONTWRITEBYTECODE

# What the figures show: shapes of quick runs, which make the forms.
POSES := $(addprefix --shape woman-a3_,standing waving t-pose)
BODIES := $(addprefix --shape ,cat0 cat4 cat8 michael0 michael3 michael10)
MEN := $(addprefix --shape ,david0 david10 michael0 michael3)
OF_PEOPLE := -d people[draw=0] --input mesh --quick
OF_SCANS := -d humans-scanlike --input mesh --quick
DRAW := $(BIN)/python -m benchmark report --force --figure forms -o results/figures
methods = $(addprefix -m ,$(1))

.PHONY: setup kernels bench test test-slow coverage lint fuzz docs speed tables check-tables publish figures clean golden
.PHONY: processors haswell generic checked

setup: $(READY)

# What pymeshlab loads, and venv needs, on a bare Linux; named before 2 GB are fetched.
LIBRARIES := 'libGL.so.1', 'libOpenGL.so.0', 'libfontconfig.so.1', 'libcom_err.so.2'
CHECK := import ctypes, ensurepip, sys; sys.platform == 'linux' and [ctypes.CDLL(name) for name in ($(LIBRARIES))]
MISSING := pymeshlab and venv need libraries: apt-get install python3-venv libgl1 libopengl0 libfontconfig1 libcom-err2

# Python compiles a module when it is imported first; compiling them all would take longer than the rest.
$(RUNNABLE): pyproject.toml constraints.txt
	@$(PYTHON) -c "$(CHECK)" 2> /dev/null || { echo '$(MISSING)'; exit 1; }
	@echo 'installing numpy, torch and what else runs need into $(VENV): 2 GB, some minutes without a word'
	$(PYTHON) -m venv $(VENV)
	$(PIP) --upgrade pip
	$(PIP) --no-compile --constraint constraints.txt --editable .
	touch $@

$(READY): $(RUNNABLE)
	@echo 'installing the tools of developers'
	$(PIP) --constraint constraints.txt --editable '.[dev]'
	touch $@

$(DOCUMENTED): $(READY)
	@echo 'installing what makes the documentation site'
	$(PIP) --constraint constraints.txt --editable '.[docs]'
	touch $@

# Each kernel is compiled by one process, before several want it at once.
kernels: $(COMPILED)

$(COMPILED): $(RUNNABLE) $(KERNELS)
	$(BIN)/python -m benchmark.kernel_cache
	touch $@ $(QUICK)

$(QUICK): $(RUNNABLE) $(KERNELS)
	$(BIN)/python -m benchmark.kernel_cache --quick
	touch $@

bench: $(QUICK)
	$(BIN)/python -m benchmark run --all --quick

# On all cores; the tests of a file stay together and share what they set up.
test: setup kernels
	$(BIN)/python -m pytest -n logical --dist loadfile

# The files with the longest tests begin first.
test-slow: setup kernels
	$(BIN)/python -m pytest -m slow -n 2 --dist loadfile --no-loadscope-reorder --durations 25

# Which lines the fast tests run, as pages in build/coverage.
coverage: setup kernels
	$(BIN)/python -m pytest -n logical --dist loadfile --cov --cov-report html:build/coverage --cov-report term:skip-covered

# What each component makes of small committed inputs, beside what it made before; ARGS="-k NAME --force-regen" writes it again.
golden: setup kernels
	$(BIN)/python -m pytest -m golden -n logical tests/golden $(ARGS)

# The golden results under the kernels of other processors, and the tests of kernels with checked indices. Each is one
# process: of several, each would compile the kernels for itself.
processors: haswell generic checked

haswell: setup kernels
	OPENBLAS_CORETYPE=Haswell ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 \
	    $(BIN)/python -m pytest -m golden tests/golden

generic: setup
	OPENBLAS_CORETYPE=Nehalem ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 MKL_CBWR=COMPATIBLE \
	    NUMBA_CPU_NAME=generic NUMBA_CACHE_DIR="$(CURDIR)/build/generic" \
	    $(BIN)/python -m pytest -m golden tests/golden

checked: setup
	NUMBA_BOUNDSCHECK=1 NUMBA_OPT=1 NUMBA_CACHE_DIR="$(CURDIR)/build/checked" \
	    $(BIN)/python -m pytest -m "kernels and not slow"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Damaged files of users, which are to be refused or read alike; what is not goes to build/found.
SEED ?= 1
FILES ?= 30000
fuzz: setup
	$(BIN)/python -m tests.fuzz $(SEED) $(FILES) build/found

# The documentation site in build/site, without a network: docs/, the docstrings of what authors use, the published tables.
docs: $(DOCUMENTED)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Beside other programs, as one table; about ten minutes. ARGS="scorer" measures a group alone.
speed: setup
	$(BIN)/python -m tools.speed $(ARGS)

# From the records in results/; needs neither data nor models.
tables: setup
	$(BIN)/python -m benchmark tables --published --paper -o results/tables

# Whether the committed tables are those that the records make.
check-tables: setup
	rm -rf build/tables && $(BIN)/python -m benchmark tables --published --paper -o build/tables
	diff -r build/tables results/tables

# Brings the records of jobs done here into results/records, which is committed, and makes the tables from them.
publish: setup
	$(BIN)/python -m tools.publish results
	$(BIN)/python -m benchmark tables --published --paper -o results/tables

# The report, and the figures of README and docs, from forms that runs keep; those of TOSCA need CANONICAL_FORMS_DATA.
CLASSICAL := classic-mds fast-mds non-metric-mds least-squares-mds constrained-mds gps mesh-unfolding skeleton
FURTHER := accelerated-mds fast-classical-scaling feature-preserved
SHOWN := least-squares-mds constrained-mds mesh-unfolding
FIELD := constrained-mds gps deformation-field
figures: setup
	$(BIN)/python -m benchmark run $(OF_PEOPLE) $(call methods,$(CLASSICAL) $(FURTHER))
	$(BIN)/python -m benchmark run -t III --input mesh $(call methods,$(SHOWN))
	$(BIN)/python -m benchmark report -o results/report
	$(DRAW)/forms.png $(OF_PEOPLE) $(POSES) $(call methods,$(CLASSICAL) $(FURTHER))
	$(BIN)/python -m benchmark run $(OF_SCANS) $(call methods,$(FIELD))
	$(DRAW)/field-humans.png $(OF_SCANS) $(call methods,$(FIELD))
	$(BIN)/python results/experiments/predictions.py
	$(BIN)/python results/experiments/canonical_depths.py
	$(BIN)/python results/experiments/finding.py
	$(DRAW)/effect.png -t III -d tosca $(call methods,$(SHOWN)) $(BODIES)
	$(BIN)/python -m tools.stack_halves results/figures/effect.png results/figures/effect-narrow.png
	$(DRAW)/david.png -t III -d tosca -m mesh-unfolding $(MEN)
	$(BIN)/python -m benchmark run -d animals --quick --input mesh --subjects cat,michael,horse \
	    -m identity $(call methods,$(CLASSICAL) $(FURTHER))
	$(BIN)/python -m tools.guide_figures results
	$(BIN)/python -m tools.failures
	$(BIN)/python -m tools.page_parts
	mkdir -p build
	$(BIN)/python -m benchmark canonicalise examples/depth/man-1/kneeling.png -m learned-streamed \
	    -o build/form.ply --picture docs/images/depth-frame.png

# Leaves the records of finished jobs.
clean:
	rm -rf $(VENV) build .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -rf results/runs/prepared results/runs/forms results/runs/signatures
