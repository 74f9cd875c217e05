#!/usr/bin/env bash
# Submit a scene without files to a Tessera farm, wait for it, and fetch its image. Needs curl and sed.
#
#     submit.sh SCENE.json OUT.png [http://127.0.0.1:7878]
#
# TESSERA_TOKEN is sent where it is set.
set -euo pipefail
scene=$1 out=$2 api=${3:-http://127.0.0.1:7878}/api/v1

call() { curl --silent --show-error --fail-with-body ${TESSERA_TOKEN:+--header "Authorization: Bearer $TESSERA_TOKEN"} "$@"; }

# The key makes it safe to send this again when no answer came.
key=$(od -An -N16 -tx1 /dev/urandom | tr -d ' \n')
job=$(printf '{"scene": %s}' "$(cat "$scene")" |
    call --retry 5 --retry-all-errors --header "Idempotency-Key: $key" --data-binary @- "$api/jobs")
id=$(sed -n 's/^{"id":"\(j[0-9]*\)".*/\1/p' <<<"$job")
frame=$(sed -n 's/.*"frames":\[{"frame":\([0-9]*\).*/\1/p' <<<"$job")

until [[ ${status:-} == completed ]]; do
    status=$(call "$api/jobs/$id" | sed -n 's/.*"status":"\([a-z]*\)".*/\1/p')
    case $status in
    failed | canceled) echo "job $id is $status" >&2 && exit 1 ;;
    completed) ;;
    *) sleep 0.5 ;;
    esac
done
call --output "$out" "$api/jobs/$id/frames/$frame/image.png"
echo "job $id: $out"
