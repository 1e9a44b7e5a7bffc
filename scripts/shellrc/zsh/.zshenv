# zsh, opened by scripts/shell: the user's own first, wherever that has its own.
ZDOTDIR=${BARC_ZDOTDIR:-$HOME}
[[ ! -r $ZDOTDIR/.zshenv ]] || . "$ZDOTDIR/.zshenv"
BARC_ZDOTDIR=${ZDOTDIR:-$HOME} ZDOTDIR=$BARC_RC/zsh
PATH=$BARC_BIN:$PATH
