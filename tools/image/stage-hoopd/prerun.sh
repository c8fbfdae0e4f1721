#!/bin/bash -e
# pi-gen hands its own functions to this script: the stage before is where we begin.
if [ ! -d "${ROOTFS_DIR}" ]; then
  copy_previous
fi
