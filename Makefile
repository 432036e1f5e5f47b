PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup sitl test test-long faults mutants coverage fuzz renew-flight dialect lock kernels sbom release docs lint bench reproducible clean

setup: .venv/.ready

.venv/.ready: pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet -e '.[dev]'
	# A client of tests/wire. What it requires brings a second OpenCV over ours; typed at, it
	# needs nothing that we have not.
	$(BIN)/pip install --quiet --no-deps MAVProxy==1.8.75
	touch $@

sitl: setup
	$(BIN)/sitl-sim run forest

# The site, in build/site; fails on a broken link.
docs: setup
	$(BIN)/pip install --quiet -e '.[docs]'
	$(BIN)/python docs/build_site.py

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest -m "not slow"

bench: setup
	$(BIN)/companion bench nmpc

test-long: setup
	$(BIN)/pytest -m slow

# The fault matrix, all rows, rows without their mechanisms, and the tables (docs/faults.md).
faults: setup
	$(BIN)/python -m pytest tests -m "row or mutation" --cache-clear --fault-table=docs/faults.md

# A sample of mutants of each wing, by seed: COUNT=40 SEED=1. Goes on where it was stopped.
COUNT ?= 40
SEED ?= 1
mutants: setup
	$(BIN)/pip install --quiet -e '.[mutants]'
	$(BIN)/python tests/mutants.py --count $(COUNT) --seed $(SEED)

# Lines that no unit test reaches, by wing, against the bounds in tests/coverage_gate.py.
coverage: setup
	$(BIN)/pip install --quiet -e '.[mutants]'
	$(BIN)/python tests/coverage_gate.py

# A million mutated frames of MAVLink and as many of MSP.
fuzz: setup
	$(BIN)/python tests/fuzz/mutate.py

# After a wanted change of behaviour: companion/bench/flight.mcap as today's code flies it.
renew-flight: setup
	$(BIN)/python -m pytest tests/replay --renew-flight

# The tables of MAVLink's messages, from pymavlink's dialect; the package needs no pymavlink.
dialect: setup
	$(BIN)/python -m tests.mavlink_bridge.wire.dialect_file > dialect.new
	mv dialect.new mavlink_bridge/wire/dialect/common.py

# What boards install, with hashes: companion/board/locks.
lock: setup
	$(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet uv
	cd companion/board/locks && for extra in base eyes; do \
	    $(CURDIR)/build/lock/bin/uv pip compile --quiet --upgrade --universal --python-version 3.11 \
	        --generate-hashes --no-emit-index-url --no-header --no-annotate \
	        $$([ $$extra = base ] || echo --extra $$extra) \
	        $(CURDIR)/pyproject.toml --output-file $$extra.txt || exit 1; \
	done

# The solver's kernels for x86_64 and aarch64, into the package: boards then need no compiler.
kernels: setup
	$(BIN)/python -m companion.control.nmpc.build_kernels

# The bill of materials of what boards install (CycloneDX); the generator validates it.
sbom: setup
	mkdir -p dist
	$(BIN)/cyclonedx-py requirements companion/board/locks/eyes.txt --pyproject pyproject.toml \
	    --output-reproducible --spec-version 1.6 --validate --output-file dist/sbom.cdx.json

# A release to publish: `make release KEY=~/.ssh/release` (docs/deploy.md).
release: setup sbom kernels
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) \
	    $(BIN)/companion deploy --make-release dist/swarm-companion.tar $(if $(KEY),--sign $(KEY))
	cd dist && sha256sum swarm-companion.tar sbom.cdx.json > SHA256SUMS

# Two builds of the committed state, in two folders, with the kernels that a release has: fails where
# wheel or release differ by a byte.
reproducible: setup
	rm -rf build/reproducible
	for n in 1 2; do \
	    git clone --quiet . build/reproducible/$$n && \
	    (cd build/reproducible/$$n && \
	        $(CURDIR)/$(BIN)/python -m companion.control.nmpc.build_kernels) && \
	    SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) \
	    $(BIN)/python -m build --wheel --outdir build/reproducible/out$$n build/reproducible/$$n \
	        > build/reproducible/log$$n && \
	    (cd build/reproducible/$$n && $(CURDIR)/$(BIN)/python -m companion deploy \
	        --wheel ../out$$n/*.whl --make-release ../out$$n/release.tar) || exit 1; \
	    sleep 2; \
	done
	cmp build/reproducible/out1/*.whl build/reproducible/out2/*.whl
	cmp build/reproducible/out1/release.tar build/reproducible/out2/release.tar
	cd build/reproducible/out1 && sha256sum *.whl release.tar

clean:
	rm -rf .venv build dist runs
