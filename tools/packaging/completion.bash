# Bash completion for haptic and hapticd. Subcommands stand here; options are what --help says.

_haptic_options() {  # COMMAND…
  "$@" --help 2>/dev/null | grep -oE '^ +(-[A-Za-z],)?--[a-z][a-z0-9-]*' | grep -oE -- '--[a-z0-9-]+'
}

_haptic() {
  local cur=${COMP_WORDS[COMP_CWORD]} program=${COMP_WORDS[0]} command=() word
  local subcommands="abuse chart device doctor edge fleet hand mesh record reload replay reset soak stability view"
  local charts="all cut economy force lcp merge pieces removal step tissue warping"
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    case " $subcommands " in *" $word "*) [ ${#command[@]} -eq 0 ] && command=("$word") && continue ;; esac
    case " $charts " in *" $word "*) [ "${command[*]}" = chart ] && command+=("$word") ;; esac
    case "$word" in list | run) [ "${command[*]}" = device ] && command+=("$word") ;; esac
  done
  if [[ $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$(_haptic_options "$program" "${command[@]}")" -- "$cur"))
  elif [ ${#command[@]} -eq 0 ]; then
    COMPREPLY=($(compgen -W "$subcommands" -- "$cur"))
  elif [ "${command[*]}" = chart ]; then
    COMPREPLY=($(compgen -W "$charts" -- "$cur"))
  elif [ "${command[*]}" = device ]; then
    COMPREPLY=($(compgen -W "list run" -- "$cur"))
  elif [ "${command[*]}" = "device run" ]; then
    COMPREPLY=($(compgen -W "falcon force-dimension inverse3 openhaptics" -- "$cur"))
  else
    COMPREPLY=($(compgen -f -- "$cur"))
  fi
}

_hapticd() {
  local cur=${COMP_WORDS[COMP_CWORD]}
  if [[ $cur == -* ]]; then
    COMPREPLY=($(compgen -W "$(_haptic_options "${COMP_WORDS[0]}")" -- "$cur"))
  else
    COMPREPLY=($(compgen -f -- "$cur"))
  fi
}

complete -o filenames -F _haptic haptic
complete -o filenames -F _hapticd hapticd
