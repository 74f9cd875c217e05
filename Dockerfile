# One image for every part of the farm: the coordinator, the workers and the command line are one binary.
FROM rust:1.95-slim-bookworm AS build
WORKDIR /src
COPY . .
RUN cargo build --locked --release -p tessera-cli

FROM debian:bookworm-slim
RUN apt-get update \
    && apt-get install -y --no-install-recommends ca-certificates curl \
    && rm -rf /var/lib/apt/lists/* \
    && useradd --system --uid 10001 --home-dir /data tessera \
    && install -d -o tessera -g tessera /data
COPY --from=build /src/target/release/tessera /usr/local/bin/tessera
COPY scenes /usr/share/tessera/scenes
USER tessera
WORKDIR /data
VOLUME /data
EXPOSE 7878
# The coordinator asks itself; a worker, whose TESSERA_COORDINATOR is set, asks whether it can reach its coordinator.
HEALTHCHECK --interval=10s --timeout=5s --start-period=20s --retries=3 \
    CMD curl --fail --silent --show-error "${TESSERA_COORDINATOR:-http://127.0.0.1:7878}/healthz"
ENTRYPOINT ["tessera"]
CMD ["coordinator", "--listen", "0.0.0.0:7878", "--data", "/data"]
