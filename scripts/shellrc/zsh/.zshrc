# zsh, opened by scripts/shell: the user's own first.
ZDOTDIR=$BARC_ZDOTDIR
[[ ! -r $ZDOTDIR/.zshrc ]] || . "$ZDOTDIR/.zshrc"
. "$BARC_RC/common.sh"
