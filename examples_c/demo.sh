#!/bin/sh
# `make demo`: generates a mesh, builds a model, opens and renders it, and picks a pixel. first.png is the first picture
# after the model was opened, converged.png the last.
#
#   MODEL=file TRIANGLES=n demo.sh BUILD_DIR
set -eu
build=$1
model=${MODEL:-}
if [ -z "$model" ]; then
    model=$build/airliner.ply
    wanted="airliner ${TRIANGLES:-2000000}"
    if [ "$(cat "$model.made" 2>/dev/null || true)" != "$wanted" ]; then
        "$build/package/cargo/release/outcrop" generate airliner --triangles "${TRIANGLES:-2000000}" -o "$model"
        echo "$wanted" > "$model.made"
    fi
fi
"$build/examples/01_quickstart_shared" "$model" "$build/demo.oc" converged.png first.png
echo "first.png and converged.png are ready"
