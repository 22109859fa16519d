# Needs cargo, a C compiler and Python 3.10+ with venv; each target sets up the rest in .venv and target/.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
PLOT_INSTALLED := $(VENV)/.plot-installed
VERIFY_INSTALLED := $(VENV)/.verify-installed
BENCH_INSTALLED := $(VENV)/.bench-installed
CAD_INSTALLED := $(VENV)/.cad-installed
SITE_INSTALLED := $(VENV)/.site-installed
# Ray needs another Gymnasium than the rest.
RAY_VENV := .venv-ray
RAY_INSTALLED := $(RAY_VENV)/.installed
WHEEL_INSTALLED := $(VENV)/.wheel-installed
# The oldest glibc that wheels run on; zig links against it on any Linux.
COMPATIBILITY ?= manylinux2014
# Of a wheel for another processor: a target of rustc that is installed.
TARGET ?=
# Runs that target's Python, to try its wheel: "qemu-aarch64 -L ROOT ROOT/usr/bin/python3".
TARGET_PYTHON ?=
# Crates with an interface in Rust.
DOCUMENTED := $(patsubst crates/%,--package %,$(filter-out crates/ballbot-py,$(wildcard crates/*)))
# What ballbot-core compiles without its other parts.
FEATURES := rigid urdf render
FUZZ_TARGETS := urdf visuals stl

TRAIN_INSTALLED := $(VENV)/.train-installed
DEMO_INSTALLED := $(VENV)/.demo-installed
# The profile of Cargo.toml that the extension is compiled with.
PROFILE := release
INSTALL = PATH="$(abspath $(BIN)):$$PATH" MATURIN_PEP517_ARGS="--locked --profile $(PROFILE)" $(BIN)/python -m pip install \
	--disable-pip-version-check --constraint constraints.txt --no-build-isolation --editable
RUST_SOURCES := $(shell find crates -name '*.rs' -o -name '*.toml')
SEED ?= 0
MINUTES ?= 5
SOAK_CONTACT ?= 100000000
SOAK_RIGID ?= 1000000
SOAK_ROBOTS ?= 5000
SOAK_MINUTES ?= 60
SECONDS_EACH ?= 60

.PHONY: help setup generate train test test-all test-builds test-ray lint docs site web wheel consumers paper verify robots controllers tunings policies transfer bench bench-core instructions firmware firmware-page fuzz soak cad demo format clean

help:
	@echo "make demo    watch a trained policy balance; installs no PyTorch"
	@echo "make train   train a policy with PPO and compare it with LQR and PID (SEED=$(SEED))"
	@echo "make test    the tests that take minutes: each model, front end and command"
	@echo "make test-all  all tests, with browsers, trainings and fuzzing (a quarter of an hour)"
	@echo "make test-builds  tests that compile for minutes: the core without features, the bindings with another crate's task"
	@echo "make test-ray  tests of training on Ray, in a separate environment, $(RAY_VENV) (minutes)"
	@echo "make lint    rustfmt, clippy, ruff, mypy, stubtest, words of the prose"
	@echo "make generate  write what follows from the tables of tasks, controllers and parameters"
	@echo "make docs    documentation of the Rust core, in target/doc"
	@echo "make site    the pages of docs/ as a site with search and the reference of the API, in target/site"
	@echo "make web     the simulator as a page for any browser, in target/web/page (needs npm and a compiler for WebAssembly)"
	@echo "make wheel   build a wheel for Linux (COMPATIBILITY=$(COMPATIBILITY)) and try it in an empty environment; TARGET=... for another processor"
	@echo "make consumers  train with third-party learners, each in a separate environment, table in docs/learners.md (SECONDS_EACH=$(SECONDS_EACH))"
	@echo "make paper   repeat the paper's experiments, report in docs/paper.md"
	@echo "make verify  check closed forms and other engines, report in docs/verification.md (ALLOW_MISSING=1 without all engines)"
	@echo "make robots  change the robot and its motors more and more, report in docs/robots.md"
	@echo "make controllers  measure disturbance limits of controllers, report in docs/controllers.md, figures of the laws in docs/laws"
	@echo "make tunings  search options of all laws with one budget, for make controllers, in validation/controllers/tuned.toml"
	@echo "make policies  train the policies that come with the package and judge them, report in docs/policies.md (half an hour)"
	@echo "make transfer  train policies with and without random robots, judge them elsewhere, report in docs/transfer.md (as long, and again for the policies)"
	@echo "make bench   compare with MuJoCo and PyBullet, report in docs/benchmark.md; bench-core: the Rust core alone"
	@echo "make instructions  compare each model's instruction counts with the kept ones (needs valgrind); ACCEPT=1 keeps new ones"
	@echo "make firmware  build the reference firmware of the folder firmware (CONTROLLER=, ROBOT=, RATE=, ...: its README)"
	@echo "make firmware-page  run it in QEMU and count its instructions, tables in docs/firmware.md"
	@echo "make fuzz    feed the readers of URDFs, visuals and STLs with broken files, each for MINUTES=$(MINUTES) (needs cargo-fuzz and a nightly compiler)"
	@echo "make soak    SOAK_CONTACT=$(SOAK_CONTACT) steps of contact, SOAK_RIGID=$(SOAK_RIGID) of rigid, SOAK_ROBOTS=$(SOAK_ROBOTS) robots, the page SOAK_MINUTES=$(SOAK_MINUTES) under load (hours)"
	@echo "make cad     build the paper's robot as solids, weigh it, write assets/meshes and the visuals of assets/bot.urdf"
	@echo "make format  format Rust and Python"
	@echo "make clean   delete everything that was built"

setup: $(INSTALLED)

generate: $(INSTALLED)
	$(BIN)/python tools/generate.py

demo: $(DEMO_INSTALLED)
	$(BIN)/ballbot view --controller assets/policies/balance.onnx

train: $(TRAIN_INSTALLED)
	$(BIN)/ballbot train balance --seed $(SEED)

# With the features and the profile of the extension, so that the crates are compiled once for both.
TESTED := base control core py tasks tests
CARGO_TEST = cargo test --locked --release $(TESTED:%=--package ballbot-%)
PYTEST = $(BIN)/pytest --numprocesses 2 --dist worksteal --durations 25

# The same random robots in each run; `make soak` has others.
test: $(INSTALLED)
	PROPTEST_RNG_SEED=1 $(CARGO_TEST)
	$(PYTEST) -m "not slow"

test-all: test
	@sh tools/install_chromium.sh
	@sh tools/install_firmware_tools.sh
	$(PYTEST) -m slow

test-builds: $(INSTALLED)
	CARGO_PROFILE_DEV_OPT_LEVEL=0 cargo test --locked --package ballbot-tests --no-default-features --test features
	BALLBOT_EXTENSION=1 $(BIN)/pytest tests/envs/test_own_task.py

test-ray: $(RAY_INSTALLED)
	PYTHONPATH="$(abspath python)" $(RAY_VENV)/bin/python -m pytest tests/distributed

lint: $(INSTALLED)
	@cargo fmt --version >/dev/null 2>&1 || { echo "rustfmt is missing: rustup component add rustfmt" >&2; exit 1; }
	@cargo clippy --version >/dev/null 2>&1 || { echo "clippy is missing: rustup component add clippy" >&2; exit 1; }
	cargo fmt --all --check
	cargo clippy --locked --workspace --all-targets -- -D warnings
	cargo clippy --locked --package ballbot-core --no-default-features -- -D warnings
	for feature in $(FEATURES); do \
		cargo clippy --locked --package ballbot-core --no-default-features --features $$feature -- -D warnings || exit 1; \
	done
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --quiet --no-deps $(DOCUMENTED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tools/check_words.py
	$(BIN)/mypy
	cd python && ../$(BIN)/python -m mypy.stubtest ballbot_rs._core

docs:
	cargo doc --locked --no-deps $(DOCUMENTED)

site: docs $(SITE_INSTALLED)
	-$(BIN)/python tools/build_web.py
	$(BIN)/python tools/build_site.py
	BALLBOT_SITE=target/site $(BIN)/pytest tests/docs/test_built_site.py

web: $(INSTALLED)
	$(BIN)/python tools/build_web.py
	@sh tools/install_chromium.sh
	BALLBOT_WEB=target/web/page $(BIN)/pytest tests/web

CHECK_WHEEL = $(BIN)/python tools/check_wheel.py target/wheels/*.whl
wheel: $(WHEEL_INSTALLED)
	rm -rf target/wheels
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python -m maturin build --profile dist --locked --zig \
		--compatibility $(COMPATIBILITY) $(if $(TARGET),--target $(TARGET)) --out target/wheels
	$(if $(TARGET_PYTHON),$(CHECK_WHEEL) --python "$(TARGET_PYTHON)",$(if $(TARGET),,$(CHECK_WHEEL)))

consumers: wheel
	$(BIN)/python -m consumers target/wheels/*.whl --seconds $(SECONDS_EACH) --page docs/learners.md

paper: $(PLOT_INSTALLED)
	$(BIN)/python -m validation.paper_replication

verify: $(VERIFY_INSTALLED)
	$(BIN)/python -m validation $(if $(ALLOW_MISSING),--allow-missing)

robots: $(PLOT_INSTALLED)
	$(BIN)/python -m validation.robots

controllers: $(PLOT_INSTALLED)
	$(BIN)/python -m validation.controllers
	$(BIN)/python -m validation.controllers.laws

tunings: $(INSTALLED)
	$(BIN)/python -m validation.controllers.tune_all

policies: $(INSTALLED)
	$(BIN)/python -m validation.policies

transfer: $(INSTALLED)
	$(BIN)/python -m validation.policies.transfer_page

bench: $(BENCH_INSTALLED)
	$(BIN)/python -m validation.benchmarks

bench-core:
	cargo bench --locked

instructions:
	$(PYTHON) tools/instructions.py $(if $(ACCEPT),--accept)

# The folder sees files from within.
firmware: $(INSTALLED)
	$(MAKE) -C firmware $(foreach name,CONTROLLER ROBOT SENSORS,$(if $(wildcard $($(name))),$(name)=$(abspath $($(name)))))

firmware-page: $(INSTALLED)
	$(BIN)/python -m validation.firmware

fuzz:
	@cargo fuzz --version >/dev/null 2>&1 || { echo "cargo-fuzz is missing: cargo install cargo-fuzz" >&2; exit 1; }
	@cargo +nightly --version >/dev/null 2>&1 || { echo "a nightly compiler is missing: rustup toolchain install nightly" >&2; exit 1; }
	@mkdir -p $(FUZZ_TARGETS:%=fuzz/target/corpus/%)
	set -e; for target in $(FUZZ_TARGETS); do \
		files=$${target#visuals}; files=$${files:-urdf}; \
		cargo +nightly fuzz run --fuzz-dir fuzz $$target fuzz/target/corpus/$$target fuzz/corpus/$$files -- \
			-dict=fuzz/$$files.dict -max_total_time=$$(( 60 * $(MINUTES) )) -max_len=16384 -timeout=10 -rss_limit_mb=2048; \
	done

soak: $(INSTALLED)
	BALLBOT_SOAK_CONTACT=$(SOAK_CONTACT) BALLBOT_SOAK_RIGID=$(SOAK_RIGID) cargo test --locked --release --test soak -- --nocapture
	$(CARGO_TEST) --test core
	BALLBOT_CASES=$(SOAK_ROBOTS) cargo test --locked --test core properties::finite
	$(BIN)/python -m tests.support.page_load $(SOAK_MINUTES)

cad: $(CAD_INSTALLED)
	$(BIN)/python -m cad

format: $(INSTALLED)
	cargo fmt --all
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) $(RAY_VENV) target fuzz/target python/ballbot_rs/_core*.so python/ballbot_rs/assets

# Its argument is the disk space in GB that a first installation takes.
define PREPARE
	@PYTHON="$(PYTHON)" DISK="$(if $(wildcard $@),1,$(1))" sh tools/check_machine.sh
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt maturin
endef

# Its argument: extras. Cargo compiles, which pip would hide, while pip fetches what Python needs.
define COMPILE_AND_INSTALL
	@$(BIN)/python tools/requirements.py $(1) > $(VENV)/requirements.txt
	@echo "compiling the extension: 3 to 4 minutes on two cores the first time, with up to 4 GB of memory"
	@VIRTUAL_ENV="$(abspath $(VENV))" $(BIN)/python -m maturin develop --locked --profile $(PROFILE) --skip-install & \
	compiler=$$!; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt \
		--requirement $(VENV)/requirements.txt || { kill $$compiler; exit 1; }; \
	echo "installed what Python needs; the compiler continues"; \
	wait $$compiler
	$(INSTALL) .
endef

BUILT_FROM := pyproject.toml constraints.txt Cargo.toml Cargo.lock $(RUST_SOURCES)

$(INSTALLED): $(BUILT_FROM)
	$(call PREPARE,12)
	@echo "installing what training, tests and tools need: up to 3 GB to download, 7 GB installed, most of it PyTorch"
	$(call COMPILE_AND_INSTALL,train dev)
	@touch $@

$(TRAIN_INSTALLED): $(BUILT_FROM)
	$(call PREPARE,8)
	@echo "installing what training needs: up to 3 GB to download, 6 GB installed, most of it PyTorch"
	$(call COMPILE_AND_INSTALL,train)
	@touch $@

$(DEMO_INSTALLED): $(BUILT_FROM)
	$(call PREPARE,2)
	@echo "installing what the page and policies need: 0.5 GB installed"
	$(call COMPILE_AND_INSTALL,view onnx)
	@touch $@

$(PLOT_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[plot]'
	@touch $@

$(VERIFY_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[verify]'
	@touch $@

# What is measured is what wheels have.
$(BENCH_INSTALLED): PROFILE := dist
$(BENCH_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[bench]'
	@touch $@

$(CAD_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[cad]'
	@touch $@

$(SITE_INSTALLED): $(INSTALLED)
	$(INSTALL) '.[site]'
	@touch $@

# The package of this folder, with the extension that the other environment has built.
$(RAY_INSTALLED): consumers/requirements/rllib.txt constraints.txt $(INSTALLED)
	test -x $(RAY_VENV)/bin/python || $(PYTHON) -m venv $(RAY_VENV)
	grep -v '^gymnasium==' constraints.txt > $(RAY_VENV)/constraints.txt
	$(RAY_VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint $(RAY_VENV)/constraints.txt --requirement consumers/requirements/rllib.txt \
		stable_baselines3 tensorboard tqdm onnx onnxruntime onnxscript pytest
	@touch $@

$(WHEEL_INSTALLED): $(BUILT_FROM)
	$(call PREPARE,2)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt ziglang
	@touch $@
