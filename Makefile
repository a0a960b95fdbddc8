# make demo   installs the requirements on a bare Debian 12, then runs the demo scene with its pictures
# make test   the same set-up, then style, types and tests: tests/**/test_mpi_*.py of the rooms in THREE below on three
#             ranks, the others on two ranks, then tests on one rank in WORKERS parallel processes
#             (make test WORKERS=8; default: the number of cores, at most four); those that ran on two ranks are left out
#             on one where they are marked slow or their room is in WHOLE, and those marked study everywhere
# make studies  the tests marked study, on two ranks and on one, and on one rank what `make test` leaves out there
# make ranks  all of tests/**/test_mpi_*.py on three ranks, or on another number (make ranks RANKS=5)
# make quick  for daily use, about a minute: style, then on one rank all tests except those marked slow (more than a
#             second) and the tests of the program, the oracles, the benchmarks and the verification studies
# make sanitize   the compiled kernels under the address and undefined-behaviour sanitizers of gcc: their rooms' tests
# make coverage   line coverage of the tests on one rank, or of some folders: make coverage TESTS=tests/contact
# make setup  the set-up only        make docs  the documentation        make clean  removes all generated files

.PHONY: demo test studies ranks quick sanitize coverage setup docs clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

PACKAGES = gcc libc6-dev python3 python3-dev python3-venv \
	python3-numpy python3-scipy python3-matplotlib \
	python3-petsc4py python3-petsc4py-real python3-slepc4py python3-slepc4py-real \
	python3-mpi4py python3-h5py-mpi openmpi-bin libopenblas0-pthread libmumps-headers-dev

# Debian's packages belong to this Python, which may not be the first on the PATH.
PYTHON = /usr/bin/python3
VENV = .venv
IN_VENV = $(VENV)/bin/python
PIP = $(IN_VENV) -m pip --disable-pip-version-check --quiet install --no-compile --constraint .ci/constraints.txt
KERNEL = $(wildcard solver/microslip/*/*.pyx $(addprefix solver/microslip/contact/,elastic_coulomb*.c return_map.c *.h) \
  $(addprefix solver/microslip/receptance/,row_products*.c row_products*.h))
GENERATORS = $(wildcard meshes/*.py)

# Open MPI needs these settings to run as root and with more ranks than cores; a waiting rank yields its core; one BLAS
# thread per rank.
export OMPI_ALLOW_RUN_AS_ROOT = 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM = 1
export OMPI_MCA_mpi_yield_when_idle = 1
export OPENBLAS_NUM_THREADS ?= 1
export MPIRUN = mpirun.openmpi
# The packages of this set-up are compatible with each other; other packages of the user are excluded.  Compiled modules are
# written, because tests start many processes.
export PYTHONNOUSERSITE = 1
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE PETSC_DIR PETSC_ARCH SLEPC_DIR VIRTUAL_ENV PIP_USER PIP_TARGET

demo: $(VENV)/installed meshes/fan_small.msh
	$(IN_VENV) -m microslip run jobs/fan_small.toml --out results/fan_small
	@$(IN_VENV) -m microslip report results/fan_small/results.h5 >/dev/null
	@echo; echo "Pictures, and all results on one page in report.html:"; ls -1 results/fan_small/*.png results/fan_small/*.html

# A test runs on all numbers of ranks unless its mark `ranks` limits them (tests/conftest.py).
# With worksteal an idle process takes half of the remaining tests of another one.
WORKERS := $(shell n=$$(nproc); echo $$((n < 4 ? n : 4)))
PYTEST = -m pytest -q --color=no
RANKS = 3
# rooms that distribute nodes, rows and pairs; three ranks test nothing new in the other rooms
THREE = assembly error_estimate harmonic linear mesh parallel
# rooms whose tests run whole jobs, or functions that whole jobs on one rank go through
WHOLE = cli continuation library modes receptance reduction restart stability statics transient verification
# two ranks on at least two cores wait for messages without yielding their core: a third less time
SPIN = $(shell [ $$(nproc) -ge 2 ] && echo --mca mpi_yield_when_idle 0)
ON_RANKS = $(PYTEST) -p no:cacheprovider -p no:xdist
# one rank waits for nobody: where it yields in each MPI call and other processes need the core, it takes many times as long
ALONE = OMPI_MCA_mpi_yield_when_idle=0
ON_ONE = $(ALONE) $(IN_VENV) $(ON_RANKS)
ONE_RANK = $(ALONE) $(IN_VENV) $(PYTEST) --numprocesses $(WORKERS) --dist worksteal

test: $(VENV)/installed $(VENV)/test-tools $(VENV)/docs-tools meshes/fan_small.msh
	$(IN_VENV) -m ruff check .
	$(IN_VENV) -m ruff format --check .
	@echo "types, and in parallel the documentation"
	@$(SPHINX) -q & docs=$$!; $(IN_VENV) -m mypy; types=$$?; wait $$docs && exit $$types
	@echo "tests on 3 ranks"
	@$(MPIRUN) --oversubscribe -n 3 $(IN_VENV) $(ON_RANKS) -m "not study" $$(find $(THREE:%=tests/%) -name 'test_mpi_*.py' | sort)
	@echo "tests on 2 ranks"
	@$(MPIRUN) --oversubscribe $(SPIN) -n 2 $(IN_VENV) $(ON_RANKS) -m "not study" --unless-on 3 --rooms "$(THREE)" \
		$$(find tests -name 'test_mpi_*.py' | sort)
	$(ONE_RANK) -m "not study" --unless-on 2 --rooms "$(WHOLE) slow"

studies: $(VENV)/installed $(VENV)/test-tools meshes/fan_small.msh
	@$(MPIRUN) --oversubscribe $(SPIN) -n 2 $(IN_VENV) $(ON_RANKS) -m study $$(find tests -name 'test_mpi_*.py' | sort)
	$(ONE_RANK) -m study
	$(ONE_RANK) -m "not study" $$(find $(WHOLE:%=tests/%) -name 'test_mpi_*.py' | sort)
	$(ONE_RANK) -m "slow and not study" $$(find tests -name 'test_mpi_*.py' $(WHOLE:%=-not -path 'tests/%/*') | sort)

ranks: $(VENV)/installed $(VENV)/test-tools meshes/fan_small.msh
	@$(MPIRUN) --oversubscribe -n $(RANKS) $(IN_VENV) $(ON_RANKS) $$(find tests -name 'test_mpi_*.py' | sort)

quick: $(VENV)/installed $(VENV)/test-tools
	$(IN_VENV) -m ruff check .
	$(IN_VENV) -m ruff format --check .
	$(ONE_RANK) -m "not slow and not study" $(addprefix --ignore=tests/,bench cli oracles/test_oracles.py verification)

SPHINX = $(IN_VENV) -m sphinx -W --keep-going -b html docs docs/_build/html

# A copy of the package is built with the sanitizers.  Python is not, so that their libraries are preloaded; leaks are not
# checked, because Python does not free its memory at exit.
SANITIZED = $(CURDIR)/build/sanitize
SANITIZERS = -fsanitize=address,undefined -fno-sanitize-recover=undefined
sanitize: $(VENV)/installed $(VENV)/test-tools
	rm -rf $(SANITIZED) && mkdir -p $(SANITIZED) && cp -r solver setup.py pyproject.toml README.md $(SANITIZED)
	find $(SANITIZED) -name '*.so' -delete
	cd $(SANITIZED) && CFLAGS="$(SANITIZERS) -g" LDFLAGS="$(SANITIZERS)" $(CURDIR)/$(IN_VENV) setup.py -q build_ext --inplace
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libubsan.so)" ASAN_OPTIONS=detect_leaks=0 \
		PYTHONPATH=$(SANITIZED)/solver $(ON_ONE) tests/contact tests/receptance tests/stability

TESTS = tests
coverage: $(VENV)/installed $(VENV)/test-tools meshes/fan_small.msh
	$(PIP) coverage
	$(IN_VENV) -m coverage run --source=solver/microslip -m pytest -q --color=no -p no:cacheprovider -p no:xdist $(TESTS)
	$(IN_VENV) -m coverage report --skip-covered --sort=cover

docs: $(VENV)/installed $(VENV)/docs-tools
	$(SPHINX)
	@echo "The documentation is here: docs/_build/html/index.html"

setup: $(VENV)/installed

meshes/fan_small.msh: $(GENERATORS) | $(VENV)/python
	$(IN_VENV) meshes/fan_sector.py --size small --out $@

# -- the steps of the set-up, each with a file that marks it as done ---------------------------------------------------

$(VENV)/packages: .ci/packages Makefile
	@mkdir -p $(VENV)
	@.ci/packages $(PACKAGES)
	@touch $@

$(VENV)/python: $(VENV)/packages .ci/constraints.txt
	$(PYTHON) -m venv --system-site-packages $(VENV)
	$(PIP) pymetis meshio shapely greenlet mapdl-archive pyNastran plotly 'pydantic>=2' rich 'Cython>=3' wheel
	@touch $@

# without symbols for debuggers the kernels compile in a fifth less time
$(VENV)/installed: $(VENV)/python setup.py pyproject.toml $(KERNEL)
	CFLAGS=-g0 $(IN_VENV) -m pip --disable-pip-version-check --quiet install --no-build-isolation --no-deps --editable .
	@touch $@

$(VENV)/test-tools: $(VENV)/python
	$(PIP) pytest pytest-xdist hypothesis ruff mypy pyuff
	-$(PIP) vtk  # large and optional: tests that open files for ParaView need it
	@touch $@

$(VENV)/docs-tools: $(VENV)/python
	$(PIP) sphinx myst-parser furo sphinx-mathjax-offline
	@touch $@

clean:
	rm -rf $(VENV) build dist results docs/_build solver/*.egg-info meshes/*.msh .pytest_cache .mypy_cache .ruff_cache
	find solver tests meshes jobs -name __pycache__ -prune -exec rm -rf {} +
	rm -f $(addprefix solver/microslip/,$(foreach room,contact receptance,$(room)/_*.c $(room)/_*.so))
