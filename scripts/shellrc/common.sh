# What bash, zsh and sh have in common.
PATH=$BARC_BIN:$PATH
PS1="(barc_sim) $PS1"
command -v ros2 >/dev/null || eval 'ros2() { printf "%s\n" "$BARC_WITHOUT_ROS2" >&2; return 127; }'
