# SPDX-License-Identifier: Apache-2.0
# What the tests want to know of the machine, each few seconds, on its console. It is laid into a copy of the image.
# Two simulated radios: one opens the probe's own Wi-Fi, as by the button, because this machine has a cable; the other
# joins it, as a headset does.
modprobe mac80211_hwsim radios=2
umask 077 # NetworkManager reads no file that others may read
joined=
address=
update=
wifi=
while sleep 10; do
	[ -n "$update" ] || update=$(lightprobe update --json 2>&1 | tr -d ' \n')
	[ -n "$address" ] || iw dev | grep -q 'type AP' || nmcli --wait 60 connection up lightprobe
	if [ -z "$address" ] && iw dev | grep -q 'type AP'; then
		point=$(iw dev | awk '/Interface/ { name = $2 } /type AP/ { print name }')
		other=$(iw dev | awk -v point="$point" '/Interface/ && $2 != point { print $2; exit }')
		headset=/run/NetworkManager/system-connections/headset.nmconnection
		{
			printf '[connection]\nid=headset\ntype=wifi\ninterface-name=%s\nautoconnect=false\n' "$other"
			printf '[wifi]\nssid=%s\n[wifi-security]\nkey-mgmt=wpa-psk\npsk=%s\n' "$(cat /etc/lightprobe/name)" \
				"$(cat /etc/lightprobe/access-point-password)"
		} >$headset
		nmcli connection load $headset
		joined=$(nmcli --wait 90 connection up headset 2>&1 | tail -n 1)
		address=$(ip -4 -o address show "$other" | awk '{ print $4 }')
		[ -z "$address" ] || wifi=$(lightprobe wifi --json 2>&1 | tr -d ' \n')
	fi
	used=$(free -m | awk '/^Mem:/ { print $3 }')
	root=$(findmnt -no OPTIONS / | cut -d, -f1)
	data=$(df -m --output=size /data | tail -n 1 | tr -d ' ')
	written=$(awk '{ print $7 * 512 }' /sys/class/block/vda/stat)
	failed=$(systemctl list-units --failed --plain --no-legend | cut -d' ' -f1 | tr '\n' ,)
	echo "report uptime_s=$(cut -d. -f1 /proc/uptime) used_mb=$used root=$root data_mb=$data written_bytes=$written" \
		"name=$(hostname) update=$update wifi=$wifi failed=$failed address=$address joined=$(echo "$joined" | tr ' ' _)"
done
