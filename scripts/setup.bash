# Sets this checkout up. The scripts beside it source this file and then run `$python`.
#
# With ROS 2 Jazzy sourced, its own packages are used: colcon builds into .setup/jazzy; only packages
# missing from ROS come from PyPI, into a venv there. Else Jazzy's wheels go into .venv, where PyPI has
# them: on x86-64 Linux with glibc. On other systems, and with BARC_ROS=none, barc_sim goes there alone
# and drives without ROS. BARC_PYTHON names the Python to use; default: the first suitable one on the
# PATH.
#
# PyPI's files have the versions and the hashes in requirements/, those to build with, too;
# scripts/lock renews them. BARC_LOCK=none takes the newest versions that setup.cfg allows.
#
# Each part has a stamp with the checksums of its inputs and is rebuilt when they change. A set-up that
# was interrupted leaves `busy` behind: then everything is rebuilt.
#
# For a Mac, bash 3.2 and POSIX's programs are enough; for Git Bash, a venv's programs may be in Scripts.

root=${BASH_SOURCE[0]%/*/*} # sourced by its absolute path
log=$root/.setup/log

message() { printf '%s\n' "$*" >&2; }
die() { message "barc_sim: $*"; exit 1; }

# set_up [EXTRA]: bring everything, with an extra of setup.cfg, up to date; set `python` and `source`,
# where ROS comes from: sourced, wheels or none.
set_up() {
  local extra=${1-} place venv stamps base version has_wheels part parts
  local input_venv input_interfaces input_package input_test
  locked || [[ $BARC_LOCK == none ]] ||
    die "BARC_LOCK can be none, to set up with the newest versions, and not '$BARC_LOCK': unset it."
  choose_place
  choose_python
  input_venv="Python $version, $root, ${ros:-$source}, ${BARC_LOCK:-locked}"
  input_venv+=$'\n'$(cksum "$root/scripts/setup.bash")
  input_interfaces=$(cd "$root/barc_interfaces" && cksum package.xml pyproject.toml CMakeLists.txt \
    cmake/*.cmake msg/*.msg ../requirements/{run,ros}.txt)
  input_package=$(cksum "$root"/{setup.cfg,setup.py,package.xml,pyproject.toml} \
    "$root"/barc_sim/{commands/__init__,interfaces/nodes}.py "$root"/requirements/*.txt)
  input_test=$input_package
  parts="venv interfaces package $extra"
  up_to_date || bring_up_to_date
  use_place
  python=$(programs)/python
}

# The folder of the environment's programs.
programs() { if [[ -d $venv/Scripts ]]; then echo "$venv/Scripts"; else echo "$venv/bin"; fi; }

choose_place() {
  ros=
  place=$root/.venv venv=$root/.venv
  stamps=$place/.stamps
  case ${BARC_ROS-} in
    '') ;;
    none) return ;;
    *) die "BARC_ROS can be none, to set up without ROS, and not '$BARC_ROS': unset it." ;;
  esac
  case ${ROS_DISTRO-} in
    '' | jazzy) ;;
    *) die "ROS 2 Jazzy is needed, but '$ROS_DISTRO' is sourced: open a terminal that sources" \
      "Jazzy, or no ROS at all." ;;
  esac
  if [[ -n ${ROS_DISTRO-} && -n ${AMENT_PREFIX_PATH-} ]]; then
    local prefixes
    IFS=: read -ra prefixes <<<"$AMENT_PREFIX_PATH"
    for ros in "${prefixes[@]}" ''; do
      [[ ! -e $ros/share/rclpy/package.xml ]] || break
    done
    [[ -n $ros ]] || die "ROS 2 Jazzy is sourced, but holds no rclpy:" \
      "install it (sudo apt install ros-jazzy-ros-base)."
    place=$root/.setup/jazzy venv=$root/.setup/jazzy/venv
    stamps=$place/.stamps
  fi
}

# Prints the version of a Python, whether PyPI has ROS for it (wheels or none), and its path.
about_python='import os, sys, sysconfig
try:
    glibc = [int(part) for part in os.confstr("CS_GNU_LIBC_VERSION").split()[1].split(".")]
except Exception:  # on a Mac, on Windows, and with musl
    glibc = []
name = "cpython-{}{}-x86_64-linux-gnu".format(*sys.version_info)
has_wheels = glibc >= [2, 28] and sysconfig.get_config_var("SOABI") == name
print("{}.{} {} {}".format(*sys.version_info[:2],
    "wheels" if has_wheels else "none", os.path.realpath(sys.executable)))'

# Set `base`, the interpreter to make the environment from, its `version`, and `source`.
choose_python() {
  local candidates=(python3 python3.13 python3.12 python3.11 python3.10 python) candidate
  local found="${BARC_PYTHON:-python3} is not there"
  [[ -z ${BARC_PYTHON-} ]] || candidates=("$BARC_PYTHON")
  for candidate in "${candidates[@]}"; do
    base=$(type -P "$candidate") || continue
    if [[ $venv/bin/python -ef $base && -e $stamps/version ]]; then
      read -r version source <"$stamps/version" # the same file: no need to start it
    else
      read -r version source base \
        < <(cd "$root" && "$base" -ISc "$about_python" 2>/dev/null) || continue
      base=${base%$'\r'}
    fi
    case $version in 3.1[0-3])
      choose_source
      return
      ;;
    esac
    [[ $found != *' not there' ]] || found="$candidate is Python $version"
  done
  die "Python 3.10, 3.11, 3.12 or 3.13 is needed, but $found: install one of them, or set" \
    "BARC_PYTHON to the path of one."
}

# Set `source`; and `safe_path`, with which the program of `python -c` begins without the working
# directory: Python 3.13 imports a module before the program can remove it from the path.
choose_source() {
  safe_path=
  [[ $version == 3.10 ]] || safe_path=-P
  has_wheels=$source
  if [[ -n $ros ]]; then
    source=sourced
  elif [[ -n ${BARC_ROS-} ]]; then
    source=$BARC_ROS
  fi
}

up_to_date() {
  [[ ! -e $stamps/busy && -x $(programs)/python ]] || return
  for part in $parts; do
    is_current "$part" || return
  done
}

is_current() {
  local input=input_$1
  [[ -e $stamps/$1 && $(<"$stamps/$1") == "${!input}" ]]
}

bring_up_to_date() {
  { mkdir -p "$root/.setup" && : >>"$root/.setup/lock"; } 2>/dev/null ||
    die "$root cannot be written to: copy the checkout to a directory of your own."
  # The programs started below inherit the lock, and keep it if the set-up is killed.
  exec 9<"$root/.setup/lock"
  if type -P flock >/dev/null; then # not on a Mac, nor in Git Bash
    flock -n 9 || { message 'Waiting for another set-up of this checkout to end.' && flock 9; }
  fi
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
    (cd "$root" && "$base" -c 'import rclpy') 2>/dev/null || die "Python $version ($base) cannot import the rclpy" \
      "of $ros: set BARC_PYTHON to the Python that it was built for (usually /usr/bin/python3)."
  fi
  [[ $source == none ]] ||
    { have_one_of "${CXX:-c++}" g++ clang++ && have_one_of "${CC:-cc}" gcc clang; } ||
    lack 'a C++ compiler' g++
  "$base" -Ic 'import ensurepip, venv' 2>/dev/null ||
    lack "Python $version's venv module" "python$version-venv"
  [[ $source == none ||
    -e $("$base" -Ic 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]] ||
    lack "Python $version's header files" "python$version-dev"
  [[ -z $lacking ]] ||
    die "$lacking must be installed first (on Debian and Ubuntu: sudo apt install$packages)$(
      [[ $source != wheels ]] || echo ', or drive without ROS (export BARC_ROS=none)')."
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
  ! locked || unset PIP_CONSTRAINT
  export PIP_NO_INPUT=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_RETRIES="${PIP_RETRIES:-2}"
  message "Setting up barc_sim with Python $version $(with_what):"
  show_seconds
  if [[ -e $stamps/busy || ! -x $(programs)/python ]] || ! is_current venv; then
    make_venv
  fi
  : >"$stamps/busy" || fail
  "make_$source"
  for part in $parts; do
    input=input_$part
    printf '%s\n' "${!input}" >"$stamps/$part" || fail
  done
  rm "$stamps/busy"
  message "Done in $SECONDS s."
}

# Count the seconds below the last message, for a person at a terminal.
show_seconds() {
  [[ -t 2 ]] || return 0
  while sleep 1 && kill -0 $$ 2>/dev/null; do printf '    %s s\r' "$SECONDS" >&2; done 9<&- &
  disown
  # shellcheck disable=SC2064 # the number of now
  trap "kill $! 2>/dev/null" EXIT
}

with_what() {
  if [[ $source != none ]]; then
    echo "and ${ros:-ROS 2 Jazzy from PyPI} (one to three minutes, once)"
  elif [[ $has_wheels == none ]]; then
    echo "and without ROS, which PyPI has for x86-64 Linux alone, and this is $(uname -sm);" \
      "barc drives all the same (a minute, once)"
  else
    echo 'and without ROS, as BARC_ROS=none asks for (a minute, once)'
  fi
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
  printf '%s\n' "$version $has_wheels" >"$stamps/version" || fail
}

make_none() {
  unset PYTHONPATH
  export PIP_ONLY_BINARY=:all: # another package would have to be compiled
  install_package
}

make_wheels() {
  # Of another environment or an enclosing run.
  unset PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
  install_package # first: setuptools comes with it
  if ! is_current interfaces; then
    message '  ROS 2, and the messages, which are compiled'
    install_locked ros
    PATH=$venv/bin:$PATH install_own ./barc_interfaces
  fi
}

make_sourced() {
  # ROS is compiled for the NumPy that it came with.
  "$venv/bin/python" -c 'import numpy; print("numpy==" + numpy.__version__)' \
    >"$place/constraints" 2>>"$log" || fail
  install_package
  if ! "$venv/bin/python" -c 'import colcon_core, colcon_cmake, colcon_ros' 2>>"$log"; then
    if locked; then install_locked colcon; else pip_install colcon-common-extensions; fi
  fi
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
    [[ $extra != test || $source != wheels ]] || extras+=,testwheels
    install_locked run ${extras//,/ }
    # compat: a path, and not an import hook that every start would have to load.
    install_own --config-settings editable_mode=compat -e ".${extras:+[$extras]}"
    hold_signals
  fi
}

# Start `barc` with the signals blocked, as scripts/run does: Ctrl-C during Python's own start would
# print a traceback. The working directory is not on the path.
hold_signals() {
  env --block-signal=INT true 2>/dev/null || return 0 # an env from before 2019
  local start='import sys; sys.path = [*filter(None, sys.path)]'
  start+='; from barc_sim.run import main; sys.exit(main())'
  rm -f "$venv/bin/barc"
  printf '#!/usr/bin/env bash\nexec env --block-signal=HUP,INT,TERM %q %s -c %q "$@"\n' \
    "$venv/bin/python" "$safe_path" "$start" >"$venv/bin/barc" || fail
  chmod +x "$venv/bin/barc" || fail
}

locked() { [[ -z ${BARC_LOCK-} ]]; }

# install_locked GROUP...: what requirements/GROUP.txt lists; of a sourced ROS only what it lacks,
# and then what that needs.
install_locked() {
  locked || return 0
  local groups=("${@/#/requirements/}") list=$place/lacking
  if [[ -z $ros ]]; then
    pip_locked "${groups[@]/%/.txt}"
    return
  fi
  while
    "$venv/bin/python" -I scripts/lock --lacking "$@" >"$list" 2>>"$log" || fail
    [[ -s $list ]]
  do
    pip_locked "$list"
  done
}

# pip_locked FILE...
pip_locked() {
  local file options=(--require-hashes --no-deps --use-pep517 --no-build-isolation)
  for file; do options+=(--requirement "$file"); done
  pip_install "${options[@]}"
}

# install_own OPTION...: a package of this checkout, for which nothing else is fetched.
install_own() {
  if locked; then
    pip_install --no-index --no-deps --no-build-isolation "$@"
  else
    pip_install ${ros:+--constraint "$place/constraints"} "$@"
  fi
}

pip_install() { logged "$(programs)/python" -Im pip install "$@"; }

logged() { "$@" >>"$log" 2>&1 || fail; }

fail() {
  local tampered
  tampered=$(sed -n '/DO NOT MATCH THE HASHES/,/Expected/s/^ *\([^ ]*==[^ ]*\).*/\1/p' "$log")
  if [[ -n $tampered ]]; then
    die "what PyPI, or its mirror, sent as ${tampered//$'\n'/ and } has another hash than in" \
      "requirements/, and is not installed: name another mirror in PIP_INDEX_URL (log: $log)."
  elif grep -qE 'No space left on device|Disk quota exceeded' "$log"; then
    die "the disk is full (the set-up needs 1 GB in $root and in ${TMPDIR:-/tmp}): free some space."
  elif grep -qE 'NewConnectionError|ConnectTimeout|ReadTimeout|ProxyError|SSLError' "$log" ||
    { [[ $source != none ]] && grep -q 'from versions: none' "$log"; }; then
    die "PyPI cannot be reached: connect this machine to the network, or name a mirror in" \
      "PIP_INDEX_URL (log: $log)."
  fi
  if [[ $source == none ]] && grep -q 'No matching distribution' "$log"; then
    die "PyPI lacks a package for Python $version on $(uname -sm): use a 64-bit Python 3.12 (log: $log)."
  fi
  die "the set-up failed: the reason is at the end of $log."
}

# The variables of a sourced setup.bash. Without them the wheels would start Python twice.
use_place() {
  if [[ $source == none ]]; then
    return
  elif [[ -n $ros ]]; then
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
