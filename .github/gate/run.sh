#!/usr/bin/env bash
# Run what a repository names and hold the numbers against its baseline; exits as `nsbench gate` does.
#   GATE_CASES, GATE_METHODS   one a line; empty: those of nsbench.toml
#   GATE_BASELINE              a file; empty: that of nsbench.toml
#   GATE_OUT                   folder of results; empty: that of nsbench.toml, else results
set -euo pipefail

cases=()
methods=()
out=()
while IFS= read -r line; do
  [[ -z ${line//[[:space:]]/} ]] || cases+=("$line")
done <<< "${GATE_CASES:-}"
while IFS= read -r line; do
  [[ -z ${line//[[:space:]]/} ]] || methods+=(-s "$line")
done <<< "${GATE_METHODS:-}"
if [[ -n ${GATE_OUT:-} ]]; then
  out=("$GATE_OUT")
fi

# 3: some runs failed. Their statuses are in the baseline too, so that the gate decides.
code=0
nsbench run "${cases[@]}" "${methods[@]}" ${out[0]:+-o "${out[0]}"} || code=$?
if [[ $code != 0 && $code != 3 ]]; then
  exit "$code"
fi
nsbench gate "${out[@]}" ${GATE_BASELINE:+--baseline "$GATE_BASELINE"} \
  --summary "${GITHUB_STEP_SUMMARY:-/dev/null}"
