# Everything runs in .venv, an environment of the project's own, which is made at need and again when setup.cfg or constraints.txt changes.
#   make run ARGS="--task hopper"     passes ARGS on to the command (run, test, slow)
#   make PYTHON=/path/to/python run   makes .venv with that interpreter (after `make clean` if there is one already)

.DEFAULT_GOAL := help
.PHONY: help run test slow check clean

PYTHON ?=
ARGS ?=
PIP := .venv/bin/python -m pip --disable-pip-version-check install --quiet -c constraints.txt

help:
	@echo "make run    set up .venv at need, then a run with default settings"
	@echo "make test   the tests, but those that take longest"
	@echo "make slow   those"
	@echo "make check  ruff and mypy"
	@echo "make clean  remove .venv, .uv, caches and build output; results under runs stay"

run: .venv/.installed
	@.venv/bin/python -m mpge_bench run $(ARGS)

test: .venv/.test
	@.venv/bin/python -m pytest -m "not slow" $(ARGS)

slow: .venv/.test
	@.venv/bin/python -m pytest -m slow $(ARGS)

check: .venv/.test
	@.venv/bin/python -m ruff check .
	@.venv/bin/python -m mypy
	@.venv/bin/python -m mypy benchmarks

clean:
	@rm -rf .venv .uv build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/.installed: setup.cfg constraints.txt .venv/.created
	@echo "Installing mpge_bench into .venv; the first time this downloads PyTorch, which takes some minutes."
	@$(PIP) -e .
	@touch $@

.venv/.test: .venv/.installed
	@echo "Installing the test tools into .venv."
	@$(PIP) -e '.[test]'
	@touch $@

# PyBullet's wheels end at CPython 3.11: an installed 3.11 or 3.10, else 3.11 by way of uv, else whatever there is and a compiler.
.venv/.created:
	@set -e; rm -rf .venv; \
	has() { "$$1" -c "import ensurepip, sys, venv; sys.exit(not ($$2))" >/dev/null 2>&1; }; \
	python='$(PYTHON)'; \
	for one in python3.11 python3 python3.10; do \
		if [ -z "$$python" ] && has $$one 'sys.version_info[:2] in ((3, 10), (3, 11))'; then python=$$one; fi; \
	done; \
	if [ -z "$$python" ]; then \
		echo "No CPython 3.11 or 3.10 with venv on the PATH; getting 3.11 through uv."; \
		if command -v uv >/dev/null; then \
			uv --quiet venv --seed --python 3.11 .venv || rm -rf .venv; \
		elif python3 -m venv .uv && echo '*' >.uv/.gitignore && .uv/bin/python -m pip --disable-pip-version-check install --quiet uv; then \
			UV_PYTHON_INSTALL_DIR="$$PWD/.uv/python" .uv/bin/uv --quiet venv --seed --python 3.11 .venv || rm -rf .venv; \
		fi; \
		if [ ! -d .venv ]; then \
			for one in python3.14 python3.13 python3.12 python3; do \
				if [ -z "$$python" ] && has $$one 'sys.version_info >= (3, 10)'; then python=$$one; fi; \
			done; \
			if [ -z "$$python" ]; then \
				echo "mpge_bench needs CPython 3.11 or 3.10 with venv; install one, or name it: make PYTHON=/path/to/python" >&2; exit 1; \
			fi; \
			echo "uv could not get CPython 3.11; going on with $$python: PyBullet is compiled from source, which needs a C++ compiler and takes minutes."; \
		fi; \
	fi; \
	if [ ! -d .venv ]; then "$$python" -m venv .venv; fi; \
	touch $@
