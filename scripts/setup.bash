# Sets this checkout up. The scripts beside it source this file and then run `$python`.
#
# Without ROS, Jazzy's wheels go into .venv. With ROS 2 Jazzy sourced, its own packages are used:
# colcon builds into .setup/jazzy; only packages missing from ROS come from PyPI, into a venv there.
# BARC_PYTHON names the Python to use; default: the first suitable one on the PATH.
#
# Each part has a stamp with the hashes of its inputs and is rebuilt when they change. A set-up that
# was interrupted leaves `busy` behind: then everything is rebuilt.

root=${BASH_SOURCE[0]%/*/*} # sourced by its absolute path
log=$root/.setup/log

message() { printf '%s\n' "$*" >&2; }
die() { message "barc_sim: $*"; exit 1; }

# set_up [EXTRA]: bring everything, with an extra of setup.cfg, up to date; set `python`.
set_up() {
  local extra=${1-} place venv stamps base version part
  local -A inputs
  choose_place
  choose_python
  inputs[venv]="Python $version, $root, ${ros:-wheels}"$'\n'$(sha256sum "$root/scripts/setup.bash")
  inputs[interfaces]=$(cd "$root/barc_interfaces" &&
    sha256sum package.xml pyproject.toml CMakeLists.txt cmake/*.cmake msg/*.msg)
  inputs[package]=$(sha256sum "$root"/{setup.cfg,setup.py,package.xml,pyproject.toml} \
    "$root"/barc_sim/commands/__init__.py)
  [[ -z $extra ]] || inputs[$extra]=${inputs[package]}
  up_to_date || bring_up_to_date
  use_place
  python=$venv/bin/python
}

choose_place() {
  case ${ROS_DISTRO-} in
    '' | jazzy) ;;
    *) die "ROS 2 Jazzy is needed, but '$ROS_DISTRO' is sourced: open a terminal that sources" \
      "Jazzy, or no ROS at all." ;;
  esac
  ros=
  if [[ -n ${ROS_DISTRO-} && -n ${AMENT_PREFIX_PATH-} ]]; then
    local prefixes
    IFS=: read -ra prefixes <<<"$AMENT_PREFIX_PATH"
    for ros in "${prefixes[@]}" ''; do
      [[ ! -e $ros/share/rclpy/package.xml ]] || break
    done
    [[ -n $ros ]] || die "ROS 2 Jazzy is sourced, but holds no rclpy:" \
      "install it (sudo apt install ros-jazzy-ros-base)."
    place=$root/.setup/jazzy venv=$root/.setup/jazzy/venv
  else
    place=$root/.venv venv=$root/.venv
  fi
  stamps=$place/.stamps
}

# Set `base`, the interpreter to make the environment from, and its `version`.
choose_python() {
  local candidates=(python3 python3.13 python3.12 python3.11 python3.10) candidate
  local found="${BARC_PYTHON:-python3} is not there"
  [[ -z ${BARC_PYTHON-} ]] || candidates=("$BARC_PYTHON")
  for candidate in "${candidates[@]}"; do
    base=$(type -P "$candidate") || continue
    if [[ $venv/bin/python -ef $base && -e $stamps/version ]]; then
      version=$(<"$stamps/version") # the same file: no need to start it
      return
    fi
    read -r version base < <(cd "$root" && "$base" -ISc 'import os, sys
print("{}.{}".format(*sys.version_info), os.path.realpath(sys.executable))' 2>/dev/null) || continue
    case $version in 3.1[0-3]) return ;; esac
    [[ $found != *' not there' ]] || found="$candidate is Python $version"
  done
  die "Python 3.10, 3.11, 3.12 or 3.13 is needed, but $found: install one of them, or set" \
    "BARC_PYTHON to the path of one."
}

up_to_date() {
  [[ ! -e $stamps/busy && -x $venv/bin/python ]] || return
  for part in "${!inputs[@]}"; do
    is_current "$part" || return
  done
}

is_current() { [[ -e $stamps/$1 && $(<"$stamps/$1") == "${inputs[$1]}" ]]; }

bring_up_to_date() {
  { mkdir -p "$root/.setup" && : >>"$root/.setup/lock"; } 2>/dev/null ||
    die "$root cannot be written to: copy the checkout to a directory of your own."
  # The programs started below inherit the lock, and keep it if the set-up is killed.
  exec 9<"$root/.setup/lock"
  flock -n 9 || { message 'Waiting for another set-up of this checkout to end.' && flock 9; }
  if ! up_to_date; then
    check_machine
    (make_parts) || exit
  fi
  exec 9<&-
}

# Name everything that is missing in one sentence.
check_machine() {
  local lacking='' packages=''
  lack() { lacking+="${lacking:+ and }$1" packages+=" $2"; }
  if [[ -n $ros ]]; then
    "$base" -c 'import rclpy' 2>/dev/null || die "Python $version ($base) cannot import the rclpy" \
      "of $ros: set BARC_PYTHON to the Python that it was built for (usually /usr/bin/python3)."
  elif [[ $(uname -sm) != 'Linux x86_64' ]]; then
    die "ROS 2 comes from PyPI for x86-64 Linux only, and this is $(uname -sm): source a ROS 2" \
      "Jazzy of its own."
  fi
  { have_one_of "${CXX:-c++}" g++ clang++ && have_one_of "${CC:-cc}" gcc clang; } ||
    lack 'a C++ compiler' g++
  "$base" -Ic 'import ensurepip, venv' 2>/dev/null ||
    lack "Python $version's venv module" "python$version-venv"
  [[ -e $("$base" -Ic 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]] ||
    lack "Python $version's header files" "python$version-dev"
  [[ -z $lacking ]] ||
    die "$lacking must be installed first (on Debian and Ubuntu: sudo apt install$packages)."
  [[ $(df -Pk "$root" | awk 'END { print $4 }') -gt 1000000 ]] ||
    die "the disk that holds $root has less than 1 GB left: free some space."
}

have_one_of() {
  local program
  for program; do
    ! type -P "$program" >/dev/null || return 0
  done
  return 1
}

# Runs in a subshell: variables unset here stay set for the run.
make_parts() {
  trap 'die "the set-up was broken off: the next call begins it again."' INT TERM HUP
  : >"$log"
  cd "$root" || fail
  unset PYTHONHOME PIP_USER PIP_TARGET PIP_PREFIX
  export PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_RETRIES="${PIP_RETRIES:-2}"
  message "Setting up barc_sim with Python $version and ${ros:-ROS 2 Jazzy from PyPI} (a minute, once):"
  if [[ -e $stamps/busy || ! -x $venv/bin/python ]] || ! is_current venv; then
    make_venv
  fi
  : >"$stamps/busy" || fail
  if [[ -n $ros ]]; then make_with_ros; else make_with_wheels; fi
  for part in "${!inputs[@]}"; do
    printf '%s\n' "${inputs[$part]}" >"$stamps/$part" || fail
  done
  rm "$stamps/busy"
  message "Done in $SECONDS s."
}

make_venv() {
  message "  an environment in ${venv#"$root/"}"
  [[ ! -e $place || -e $stamps ]] || rmdir "$place" 2>/dev/null ||
    die "$place was not made by this script: move it out of the way."
  # `busy` is created first and removed last, in case the set-up is interrupted here.
  { mkdir -p "$stamps" && : >"$stamps/busy"; } 2>>"$log" || fail
  logged find "$place/" -mindepth 1 -maxdepth 1 ! -name .stamps -exec rm -rf {} +
  logged find "$stamps" -type f ! -name busy -delete
  logged "$base" -Im venv --prompt barc_sim ${ros:+--system-site-packages} "$venv"
  printf '%s\n' "$version" >"$stamps/version" || fail
}

make_with_wheels() {
  # Of another environment or an enclosing run.
  unset PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
  if ! is_current interfaces; then
    message '  ROS 2, and the messages, which are compiled'
    pip_install ./barc_interfaces
  fi
  install_package
}

make_with_ros() {
  # ROS is compiled for the NumPy that it came with.
  "$venv/bin/python" -c 'import numpy; print("numpy==" + numpy.__version__)' \
    >"$place/constraints" 2>>"$log" || fail
  install_package --constraint "$place/constraints"
  "$venv/bin/python" -c 'import colcon_core, colcon_cmake, colcon_ros' 2>>"$log" ||
    pip_install colcon-common-extensions
  message '  the packages with colcon'
  # With this Python, so that the entry points find what was installed for it.
  PATH=$venv/bin:$PATH logged "$venv/bin/python" -c \
    'from colcon_core.command import main; raise SystemExit(main())' --log-base "$place/log" \
    build --base-paths . barc_interfaces --merge-install --build-base "$place/build" \
    --install-base "$place/install"
}

install_package() {
  if ! is_current package || { [[ -n $extra ]] && ! is_current "$extra"; }; then
    message '  barc_sim and the Python packages that it needs'
    local extras=$extra
    [[ $extra != test || -n $ros ]] || extras+=,testwheels
    # compat: a path, and not an import hook that every start would have to load.
    pip_install "$@" --config-settings editable_mode=compat -e ".${extras:+[$extras]}"
  fi
}

pip_install() { logged "$venv/bin/python" -Im pip install "$@"; }

logged() { "$@" >>"$log" 2>&1 || fail; }

fail() {
  if grep -qE 'No space left on device|Disk quota exceeded' "$log"; then
    die "the disk is full (the set-up needs 1 GB in $root and in ${TMPDIR:-/tmp}): free some space."
  elif grep -qE 'NewConnectionError|ConnectTimeout|ReadTimeout|ProxyError|SSLError|from versions: none' "$log"; then
    die "PyPI cannot be reached: connect this machine to the network, or name a mirror in" \
      "PIP_INDEX_URL (log: $log)."
  fi
  die "the set-up failed: the reason is at the end of $log."
}

# The variables of a sourced setup.bash. Without them the wheels would start Python twice.
use_place() {
  if [[ -n $ros ]]; then
    local install=$place/install
    prepend PYTHONPATH "$install"/lib/python3*/site-packages
    prepend PYTHONPATH "$root"
    prepend LD_LIBRARY_PATH "$install/lib"
    prepend AMENT_PREFIX_PATH "$install"
  else
    prepend LD_LIBRARY_PATH "$venv"/lib/python3*/site-packages/ros_*.libs
    prepend LD_LIBRARY_PATH "$venv/lib"
    export AMENT_PREFIX_PATH=$venv _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  fi
}

# prepend VARIABLE PATH...
prepend() {
  local name=$1 path
  for path in "${@:2}"; do
    [[ :${!name-}: == *:"$path":* ]] || export "$name=$path${!name:+:${!name}}"
  done
}
