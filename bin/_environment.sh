# shellcheck shell=bash
# Virtual environments for the commands beside this file. To be sourced; ROOT is the checkout.
#
#   environment NAME EXTRA [PYTHON]   makes ROOT/NAME, installs this checkout with EXTRA (base, demo, body, test, docs or dev)
#                                     and sets ENV_PYTHON. Does nothing when a stamp says that it is up to date.
#   optional_packages NAME EXTRA      adds EXTRA if it can be had, says so and goes on if not.
#   find_python VERSION               sets FOUND_PYTHON to an interpreter of that minor version that really runs,
#                                     or FOUND_PYTHON="" and NOT_FOUND to the reason.
#
# A stamp holds what an environment was made from: the place of the checkout, the version of Python and the text of
# pyproject.toml. Only wheels are installed, so no compiler is ever needed. The bash 3.2 of macOS is enough.

# A sourced ROS workspace puts its packages and its pytest plugins on this path; none of them belongs in here.
unset PYTHONPATH PYTHONHOME
# Compiled code is kept: without it each test process spends three seconds on compiling its tools.
unset PYTHONDONTWRITEBYTECODE

say() {
    printf '%s: %s\n' "${0##*/}" "$*" >&2
}

die() {
    say "$@"
    exit 2
}

# Print "VERSION BASE_EXECUTABLE" of an interpreter, or nothing if it does not run: a version manager's shim may exist
# and fail.
probe_python() {
    "$1" -I -c 'import sys
print("%d.%d.%d" % sys.version_info[:3], getattr(sys, "_base_executable", "") or sys.executable)' 2>/dev/null </dev/null
}

can_make_environments() {
    "$1" -I -c 'import ensurepip, venv' >/dev/null 2>&1 </dev/null
}

# Set NEW_PYTHON and NEW_VERSION to what new environments are made with, or end with what is missing.
choose_python() {
    local probe minor
    probe=$(probe_python "$1") || probe=""
    if [ -z "$probe" ]; then
        die "'$1' does not run. Python 3.10 or newer is needed (Debian, Ubuntu: apt install python3 python3-venv)."
    fi
    NEW_VERSION=${probe%% *}
    minor=${NEW_VERSION#*.}
    minor=${minor%%.*}
    if [ "${NEW_VERSION%%.*}" -ne 3 ] || [ "$minor" -lt 10 ]; then
        die "'$1' is Python $NEW_VERSION, 3.10 or newer is needed. To choose another one: PYTHON=python3.12 $0"
    fi
    # The base executable, so that an activated environment can be made anew without cutting off its own branch.
    NEW_PYTHON=${probe#* }
    if ! can_make_environments "$NEW_PYTHON"; then
        die "Python $NEW_VERSION has no venv or ensurepip module (Debian, Ubuntu: apt install python3.$minor-venv)."
    fi
}

# Print what an environment with this version of Python is made from.
stamp_text() {
    printf '%s\n%s\n' "$ROOT" "$1"
    cat "$ROOT/pyproject.toml"
}

# True if the stamp KIND of DIR is true still. WANTED_VERSION may be empty: any version will do.
is_current() {
    local dir=$1 kind=$2 wanted_version=${3:-} version
    [ -f "$dir/.$kind" ] || return 1
    version=$("$dir/bin/python" -I -S -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null) || return 1
    [ -z "$wanted_version" ] || [ "$version" = "$wanted_version" ] || return 1
    [ "$(cat "$dir/.$kind")" = "$(stamp_text "$version")" ]
}

put_stamp() {
    local dir=$1 kind=$2 version
    version=$(probe_python "$dir/bin/python")
    stamp_text "${version%% *}" >"$dir/.$kind"
}

# Two commands started at once must not set up the same environment. The lock is on a file that is there anyway.
lock() {
    exec 9<"$ROOT/pyproject.toml"
    if command -v flock >/dev/null 2>&1; then
        flock 9
    fi
}

unlock() {
    exec 9<&-
}

# install DIR EXTRA [PIP OPTIONS]: by uv, which takes a tenth of pip's time, or by pip where that fails and says why.
install() {
    local python="$1/bin/python" target="$ROOT[$2]"
    [ "$2" != base ] || target=$ROOT
    shift 2
    if has_uv "$python"; then
        "$python" -I -m uv --quiet pip install --python "$python" --only-binary :all: -e "$target" 2>/dev/null && return
    fi
    pip_install "$python" "$@" -e "$target"
}

# An index or a proxy of pip's own configuration is not uv's to pass by.
has_uv() {
    ! "$1" -I -m pip config list 2>/dev/null | grep -qE 'index|proxy' &&
        { "$1" -I -m uv --version >/dev/null 2>&1 || pip_install "$1" --retries 1 --timeout 15 uv 2>/dev/null; }
}

# pip_install PYTHON PIP OPTIONS...
pip_install() {
    "$1" -I -m pip --quiet --disable-pip-version-check --no-input install --only-binary :all: "${@:2}"
}

environment() {
    local name=$1 extra=$2 python=${3:-${PYTHON:-}} dir="$ROOT/$1" started=$SECONDS probe
    ENV_PYTHON="$dir/bin/python"
    NEW_VERSION=""
    [ -z "$python" ] || choose_python "$python"
    if is_current "$dir" "installed-$extra" "$NEW_VERSION"; then
        return 0
    fi
    lock
    if ! is_current "$dir" "installed-$extra" "$NEW_VERSION"; then
        probe=$(probe_python "$ENV_PYTHON") || probe=""
        if [ "${probe%% *}" != "${NEW_VERSION:-${probe%% *}}" ] || ! "$ENV_PYTHON" -I -m pip --version >/dev/null 2>&1; then
            choose_python "${python:-python3}"
            say "making $name with Python $NEW_VERSION"
            "$NEW_PYTHON" -I -m venv --clear "$dir" || die "could not make $dir with $NEW_PYTHON"
        fi
        say "installing the checkout and its '$extra' packages into $name (once)"
        install "$dir" "$extra" || die "installing failed, see above. Can the package index be reached?"
        put_stamp "$dir" installed-base
        [ "$extra" != dev ] || put_stamp "$dir" installed-test
        case $extra in test | dev) put_stamp "$dir" installed-demo ;; esac
        put_stamp "$dir" "installed-$extra"
        say "$name is ready after $((SECONDS - started)) s"
    fi
    unlock
}

optional_packages() {
    local name=$1 extra=$2 dir="$ROOT/$1"
    if is_current "$dir" "installed-$extra" || is_current "$dir" "without-$extra"; then
        return 0
    fi
    lock
    say "adding the optional '$extra' packages to $name (once)"
    if install "$dir" "$extra" --retries 1 --timeout 15; then
        put_stamp "$dir" "installed-$extra"
    else
        say "going on without them; to try again: rm $dir/.without-$extra"
        put_stamp "$dir" "without-$extra"
    fi
    unlock
}

find_python() {
    local version=$1 candidate probe
    FOUND_PYTHON=""
    NOT_FOUND="there is no python$version"
    while IFS= read -r candidate; do
        [ -x "$candidate" ] || continue
        probe=$(probe_python "$candidate") || probe=""
        case $probe in
            "$version".*) ;;
            *)
                NOT_FOUND="$candidate does not run"
                continue
                ;;
        esac
        if ! can_make_environments "${probe#* }"; then
            NOT_FOUND="$candidate has no venv or ensurepip module"
            continue
        fi
        FOUND_PYTHON=${probe#* }
        return 0
    done <<CANDIDATES
$(type -ap "python$version" || true)
$(printf '%s\n' "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python)
$(printf '%s\n' "${XDG_DATA_HOME:-$HOME/.local/share}/uv/python/cpython-$version".*/bin/python)
CANDIDATES
}
