# saf-gen with its fast renderer. Build: docker build --tag saf-gen .
# Run (on a card with --gpus all): docker run --rm --volume "$PWD/datasets:/work/datasets" saf-gen generate quickstart
FROM python:3.12-slim-trixie AS build
WORKDIR /src
COPY pyproject.toml README.md LICENSE ./
COPY tools/package_page.py tools/
COPY saf_gen saf_gen
COPY scenes scenes
COPY recipes recipes
COPY datasets/sample datasets/sample
RUN python -m pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.12-slim-trixie
# Mitsuba's fast variant needs LLVM, and Dr.Jit libatomic, which no wheel contains.
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libatomic1 libllvm19 \
 && rm -rf /var/lib/apt/lists/*
COPY constraints.txt /tmp/constraints.txt
RUN --mount=type=bind,from=build,source=/wheels,target=/wheels \
    wheel=$(echo /wheels/*.whl) \
 && python -m pip install --no-cache-dir --constraint /tmp/constraints.txt "${wheel}[render]"
# Numba and Dr.Jit keep compiled kernels in the home folder. With another --user, which has no home folder, caches are in /tmp.
RUN useradd --uid 1000 --create-home saf && mkdir /work && chown saf /work
USER 1000
# Rays on a card need OptiX, which NVIDIA's container runtime leaves out unless graphics is named.
ENV NUMBA_CACHE_DIR=/tmp/numba MPLCONFIGDIR=/tmp/matplotlib NVIDIA_DRIVER_CAPABILITIES=compute,utility,graphics
WORKDIR /work
ENTRYPOINT ["saf-gen"]
CMD ["--help"]
