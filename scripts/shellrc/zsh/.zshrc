# zsh, opened by scripts/shell: the user's own first.
ZDOTDIR=$BARC_ZDOTDIR
[[ ! -r $ZDOTDIR/.zshrc ]] || . "$ZDOTDIR/.zshrc"
. "$BARC_RC/common.sh"
(( $+functions[compdef] )) || { autoload -Uz compinit && compinit -uD; }
eval "$(barc --completion zsh)"
