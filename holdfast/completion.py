"""Shell completion: commands by name, their options out of their own `--help`, and files."""

from collections.abc import Iterable

EXAMPLES = """\
examples:
  holdfast completion bash > /etc/bash_completion.d/holdfast      for everybody, as root
  eval "$(holdfast completion bash)"                              in ~/.bashrc
  eval "$(holdfast completion zsh)"                               in ~/.zshrc, after compinit
"""

_ZSH = "autoload -U +X bashcompinit && bashcompinit\n"
_BASH = """\
_holdfast() {
    local word=${COMP_WORDS[COMP_CWORD]} words=
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="@COMMANDS@ --help --version"
    elif [ "${word:0:1}" = - ]; then
        words=$(holdfast "${COMP_WORDS[1]}" --help 2>/dev/null | grep -oE -- '--[a-z][a-z-]*' | sort -u)
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}
complete -o default -F _holdfast holdfast
"""


def script(shell: str, commands: Iterable[str]) -> str:
    """Return the function and its registration, for "bash" or "zsh"."""
    return (_ZSH if shell == "zsh" else "") + _BASH.replace("@COMMANDS@", " ".join(commands))
