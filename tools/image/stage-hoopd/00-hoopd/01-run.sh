#!/bin/bash -e
# The source stays in the image: `make uninstall` and the next `make install` are run from it.
source_folder="${ROOTFS_DIR}/usr/src/hoopd"
rm -rf "${source_folder}"
install -d -m 755 "${source_folder}"
tar -x -f files/hoopd.tar -C "${source_folder}"
