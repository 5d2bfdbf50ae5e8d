# docker build -t canonical-forms . && docker run --rm -v "$PWD:/work" canonical-forms run -d FOLDER
FROM python:3.11-slim AS build
WORKDIR /source
COPY . .
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim
# What pymeshlab loads.
RUN apt-get update \
    && apt-get install -y --no-install-recommends libgl1=1.* libopengl0=1.* libfontconfig1=2.* libcom-err2=1.* \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --uid 1000 --create-home user \
    && install -d -o 1000 /work
COPY --from=build /wheels /wheels
COPY constraints.txt /wheels/
# The CPU build of torch: its version is that of constraints.txt with +cpu, which pip prefers.
RUN pip install --no-cache-dir --extra-index-url https://download.pytorch.org/whl/cpu --constraint /wheels/constraints.txt /wheels/*.whl
USER 1000
RUN python -m benchmark.kernel_cache
WORKDIR /work
ENTRYPOINT ["canonical-forms"]
CMD ["--help"]
