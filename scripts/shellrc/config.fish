# fish, opened by scripts/shell, after the user's own.
set -gx PATH $BARC_BIN $PATH
functions -q _barc_fish_prompt; or functions -c fish_prompt _barc_fish_prompt
function fish_prompt
    printf '(barc_sim) '
    _barc_fish_prompt
end
if not command -q ros2
    function ros2
        echo $BARC_WITHOUT_ROS2 >&2
        return 127
    end
end
barc --completion fish | source
