# What `tutorial.py` makes of a page is sourced after this file; "$PAGE" names the page.
set -Eeuo pipefail
trap 'status=$?; echo "$PAGE:$LINENO: exit status $status: $BASH_COMMAND" >&2' ERR
trap end_all EXIT

started=()  # process groups in the background

# Start the commands of stdin and go on when they have said $1; end_all ends them by Ctrl-C.
runs_until() {
    local code said
    code=$(cat)
    said=$(mktemp)
    set -m  # a group of its own, in which Ctrl-C is not ignored
    bash -Eeuo pipefail -c "$code" >"$said" 2>&1 &
    set +m
    started+=($!)
    until grep -qF -- "$1" "$said"; do
        if ! kill -0 $! 2>/dev/null; then
            echo "ended before it said '$1':" >&2
            cat "$said" >&2
            return 1
        fi
        sleep 0.1
    done
    cat "$said"
}

# Run the commands of stdin, which must end with exit status $1.
exits() {
    local status=0
    bash -Eeuo pipefail -c "$(cat)" || status=$?
    [ "$status" = "$1" ] || { echo "exit status $status, not $1" >&2; return 1; }
}

end_all() {
    local failed=$? group status
    for group in "${started[@]}"; do
        status=0
        kill -INT -- "-$group" 2>/dev/null || true
        wait "$group" || status=$?
        case $status in
            0 | 130) ;;
            *) echo "$PAGE: exit status $status of what ran in the background" >&2; failed=1 ;;
        esac
    done
    exit "$failed"
}
