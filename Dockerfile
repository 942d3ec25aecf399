# Two images of one repository:
#   docker build --target trainer -t duckpilot-trainer .      offline training (CPU, or CUDA with --gpus all)
#   docker build --target robot   -t duckpilot-robot .        the runtime, as on a Jetson
#
# Every base with Python 3.11 (trainer) or 3.8 and newer (robot), venv and make will do. PyPI's torch is the CUDA build;
# for the small CPU build: --build-arg PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu
ARG TRAINER_BASE=python:3.11-bookworm
ARG ROBOT_BASE=python:3.8-slim-bookworm

FROM ${TRAINER_BASE} AS trainer
ARG PIP_EXTRA_INDEX_URL=
RUN useradd --create-home duck
USER duck
WORKDIR /home/duck/duckpilot
# The environment first: it changes seldom, and a layer that did not change is not built again.
COPY --chown=duck pyproject.toml constraints.txt Makefile README.md LICENSE ./
RUN make setup
COPY --chown=duck . .
# Again, now that there are packages to find: without them an editable install puts nothing on the path.
RUN mkdir -p runs && .venv/bin/python -m pip install --quiet --no-deps --editable .
VOLUME /home/duck/duckpilot/runs
ENTRYPOINT ["/home/duck/duckpilot/.venv/bin/python", "-m"]
CMD ["trainer", "train", "--help"]

FROM ${ROBOT_BASE} AS robot
RUN useradd --create-home duck
USER duck
WORKDIR /home/duck/duckpilot
COPY --chown=duck pyproject.toml constraints-nano.txt README.md LICENSE ./
COPY --chown=duck robot robot
COPY --chown=duck localizer_node localizer_node
RUN mkdir -p trainer sim_pybullet tools runs \
 && python3 -m venv .venv \
 && .venv/bin/python -m pip install --no-cache-dir --quiet --constraint constraints-nano.txt --editable .
VOLUME /home/duck/duckpilot/runs
ENTRYPOINT ["/home/duck/duckpilot/.venv/bin/python", "-m"]
CMD ["robot", "--help"]
