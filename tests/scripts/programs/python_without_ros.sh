# A Python for which PyPI has no ROS: as on a Mac, or in Git Bash, where lines end with CR LF.
# Virtual environments have their programs in FOLDER.
case "$*" in
  *realpath*) printf '3.12 none %s\r\n' "$0" ;;
  *'-Im venv'*)
    mkdir -p "${@: -1}/FOLDER"
    cp "$0" "${@: -1}/FOLDER/python"
    ;;
  *'pip install'*) [[ $PIP_ONLY_BINARY == :all: ]] && printf '%s\n' "$*" ;;
  *barc_sim.run*) printf 'drives: %s\n' "$*" ;;
esac
