# The command line: docker build -t evrig . && docker run --rm -v "$PWD:/work" evrig info SESSION
FROM rust:1.89-slim-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc g++ make cmake \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /evrig
COPY . .
RUN rm -f rust-toolchain.toml && cargo build --locked --release && strip target/release/evrig

FROM debian:bookworm-slim
COPY --from=build /evrig/target/release/evrig /usr/local/bin/evrig
COPY LICENSE-APACHE LICENSE-MIT /usr/share/doc/evrig/
WORKDIR /work
ENTRYPOINT ["evrig"]
