# Two commands matter: `make demo` and `make test`. Both install what is missing first.
.PHONY: demo demo-recording test lint doc fuzz bench audit setup clean

# One mission, end to end, into out/demo. DEMO="--help" shows its options.
demo: setup
	cargo build --release --locked --bins
	target/release/demo $(DEMO)

# The same on a real recording: people walking through an office, by the University of Bonn.
RECORDING ?= ../shared/data/rgbd/bonn_crowd_a
demo-recording: setup
	cargo build --release --locked --bins
	target/release/demo --recording $(RECORDING) $(DEMO)

# Every test: unit, property, end to end and with real peers.
test:
	tools/setup peers
	cargo build --workspace --locked --bins --tests
	if cargo nextest --version >/dev/null 2>&1; then cargo nextest run --workspace --locked; \
	else cargo test --workspace --locked --lib --bins --tests; fi
	cargo test --workspace --locked --doc

lint: setup
	cargo fmt --check
	cargo clippy --workspace --all-targets --locked -- -D warnings

doc: setup
	RUSTDOCFLAGS=-Dwarnings cargo doc --workspace --no-deps --locked

# Hostile bytes, five minutes for each reader.
fuzz: setup
	maps/fuzz/run
	maps/octomap/fuzz/run
	mavlink_ext/fuzz/run

bench: setup
	cargo bench --workspace --locked --benches

# Dependencies: licences, duplicates, sources. Not part of CI: cargo-deny is slow to build.
audit:
	command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny --offline check bans licenses sources

setup:
	tools/setup

clean:
	cargo clean
	rm -rf out
