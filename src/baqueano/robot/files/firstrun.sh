#!/bin/bash
# Set name, user, key and network as root, once, at the first start of a Raspberry Pi. The log stays on the card. This
# file contains a password, so it removes itself. R is the root of the machine: "", except in a test.
R=${R:-}
B=$R/boot/firmware
[ -d "$B" ] || B=$R/boot
exec >>"$B/firstrun.log" 2>&1
set -x +e

echo @name@ >"$R/etc/hostname"
grep -q '^127.0.1.1' "$R/etc/hosts" || echo 127.0.1.1 >>"$R/etc/hosts"
sed -i 's/^127\.0\.1\.1.*/127.0.1.1\t'@name@'/' "$R/etc/hosts"
hostname @name@

if [ -x "$R/usr/lib/userconf-pi/userconf" ]; then # names the first user of the image, and ends its dialog
  "$R/usr/lib/userconf-pi/userconf" @user@ '*'
fi
id -u @user@ || useradd --create-home --shell /bin/bash --groups sudo,dialout,i2c,gpio,input @user@
echo @user@ 'ALL=(ALL) NOPASSWD: ALL' >"$R/etc/sudoers.d/010_baqueano"
chmod 440 "$R/etc/sudoers.d/010_baqueano"
mkdir -p "$R/home/"@user@/.ssh
echo @key@ >"$R/home/"@user@/.ssh/authorized_keys
chmod 700 "$R/home/"@user@/.ssh
chmod 600 "$R/home/"@user@/.ssh/authorized_keys
chown -R @user@: "$R/home/"@user@
systemctl enable ssh
systemctl start --no-block ssh

set +x # a password
connection=@connection@
if [ -n "$connection" ]; then
  mkdir -p "$R/etc/NetworkManager/system-connections"
  (umask 077 && printf %s "$connection" >"$R/etc/NetworkManager/system-connections/baqueano.nmconnection")
  set -x
  raspi-config nonint do_wifi_country @country@
  rfkill unblock wifi
  nmcli connection reload && nmcli connection up baqueano
fi
set -x

sed -i 's/ systemd\.run[^ ]*//g; s/ systemd\.unit=kernel-command-line\.target//' "$B/cmdline.txt"
rm -f "$B/firstrun.sh"
exit 0
