# pi-gen feeds these lines to a shell inside the image; a line that fails ends the build.
make -C /usr/src/hoopd install PYTHON=/usr/bin/python3 LAMP_GPIO="${LAMP_GPIO:-18}"
test "$(systemctl is-enabled hoopd.service)" = enabled
hoopd --version
