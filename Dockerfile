# docker build -t ballbot .
# docker run --rm -v "$PWD/runs:/home/ballbot/runs" ballbot train balance
# docker run --rm --network host ballbot view          # the page listens on 127.0.0.1 alone
FROM rust:1-slim-bookworm AS build
RUN apt-get update && apt-get install --yes --no-install-recommends python3-venv && rm -rf /var/lib/apt/lists/*
WORKDIR /ballbot
COPY . .
RUN python3 -m venv /venv && /venv/bin/pip install --no-cache-dir --constraint constraints.txt maturin
RUN PATH="/venv/bin:$PATH" MATURIN_PEP517_ARGS="--locked --profile dist" /venv/bin/pip wheel --no-cache-dir --no-deps --no-build-isolation \
    --wheel-dir /wheels .

FROM python:3.12-slim-bookworm
COPY constraints.txt /wheels/
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir --constraint /wheels/constraints.txt \
    "$(echo /wheels/*.whl)[train,view,export,identify,link,tune,mcap,pandas,completion]" && rm -rf /wheels
RUN useradd --create-home ballbot
USER ballbot
WORKDIR /home/ballbot
ENV OMP_NUM_THREADS=1
ENTRYPOINT ["ballbot"]
CMD ["--help"]
