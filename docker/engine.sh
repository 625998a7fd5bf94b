# Sourced by docker/build and docker/run: which engine to use, and the image's name.
# ENGINE=docker|podman|buildah overrides the choice. podman and buildah share their images.
image=${IMAGE:-localhost/dea_fenicsx:latest}

fail() {
    printf '%s: %s\n' "docker/$(basename "$0")" "$*" >&2
    exit 1
}

# Docker, where its daemon answers; else buildah or podman.
find_builder() {
    if [ -n "${ENGINE:-}" ]; then
        echo "$ENGINE"
    elif command -v docker >/dev/null && docker info >/dev/null 2>&1; then
        echo docker
    elif command -v buildah >/dev/null; then
        echo buildah
    elif command -v podman >/dev/null; then
        echo podman
    else
        fail "install docker, podman or buildah: none of them is here" \
            "(on Debian: apt-get install buildah mmdebstrap)."
    fi
}

# Machines that are containers themselves often let podman build but not run: buildah then does.
find_runner() {
    local builder
    builder=$(find_builder)
    if [ "$builder" = buildah ] && [ -z "${ENGINE:-}" ] && command -v podman >/dev/null &&
        podman run --rm "$image" true >/dev/null 2>&1; then
        echo podman
    else
        echo "$builder"
    fi
}
