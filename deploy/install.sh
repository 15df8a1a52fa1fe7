#!/usr/bin/env bash
# Install the robot on Raspberry Pi OS, Ubuntu, Debian or a Jetson: its own user, an environment in
# /opt/agribot, names for its devices and a service of systemd. Run it again to update; what is as
# it should be is left alone, and /etc/agribot/agribot.env is never written twice.
#
#   sudo deploy/install.sh [--dry-run] [--from DIR|WHEEL] [--python PYTHON] [--extras NAMES]
set -euo pipefail

here="$(cd "$(dirname "$0")" && pwd)"
root="${DESTDIR:-}"  # a folder that stands for /, as packagers and tests use it
from="$(dirname "$here")"
extras="hardware,ui"
python=""
is_dry=no

usage() {
  sed -n '2,6s/^# \{0,1\}//p' "$0"
  cat <<'TEXT'
  --dry-run       say what would be done, and do nothing
  --from          the folder or wheel to install (default: the folder of this script)
  --python        Python 3.11 or newer (default: the newest one that is found)
  --extras        of the package (default: hardware,ui)
TEXT
}

say() { printf '%s\n' "$*"; }
stop() { printf 'install.sh: %s\n' "$*" >&2; exit 2; }
do_it() {
  if [ "$is_dry" = yes ]; then say "would run: $*"; else say "running: $*"; "$@"; fi
}

while [ $# -gt 0 ]; do
  case "$1" in
    --dry-run) is_dry=yes ;;
    --from) from="${2:?--from needs a folder or a wheel}"; shift ;;
    --python) python="${2:?--python needs a program}"; shift ;;
    --extras) extras="${2:?--extras needs names}"; shift ;;
    -h | --help) usage; exit 0 ;;
    *) usage >&2; stop "unknown option $1" ;;
  esac
  shift
done

name_machine() {
  local model=""
  [ -r "$root/proc/device-tree/model" ] && model="$(tr -d '\0' <"$root/proc/device-tree/model")"
  # shellcheck disable=SC1091
  say "$(. "$root/etc/os-release" && printf '%s' "$PRETTY_NAME") on ${model:-a PC}, $(uname -m)"
}

check_machine() {
  [ -r "$root/etc/os-release" ] || stop "no /etc/os-release; this script knows Debian, Raspberry Pi OS, Ubuntu and Jetson"
  case "$(uname -m)" in
    x86_64 | aarch64) ;;
    *) stop "$(uname -m) has no wheels of onnxruntime; install a 64-bit system" ;;
  esac
  command -v systemctl >/dev/null || stop "no systemd here; start agribot run by hand"
  if [ "$is_dry" = no ] && [ -z "$root" ] && [ "$(id -u)" != 0 ]; then
    stop "must be root to write /opt and /etc: sudo $0"
  fi
}

is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

# JetPack 6 is an Ubuntu 22.04 with Python 3.10; python3.11 stands beside it, in its own archive.
find_python() {
  local name
  if [ -n "$python" ]; then
    is_new_enough "$python" || stop "$python is older than 3.11, or does not start"
    return
  fi
  for name in python3 python3.14 python3.13 python3.12 python3.11; do
    if command -v "$name" >/dev/null && is_new_enough "$name"; then python="$name"; return; fi
  done
  for name in python3.13 python3.12 python3.11; do
    if apt-cache show "$name-venv" >/dev/null 2>&1; then
      do_it apt-get install -y --no-install-recommends "$name" "$name-venv"
      python="$name"
      return
    fi
  done
  stop "needs Python 3.11, which this system does not have (on a Jetson: JetPack 6, whose Ubuntu 22.04 has python3.11 in 'universe'); or bring one, as with 'uv python install 3.12', and give it by --python"
}

ensure_venv_module() {
  if [ "$is_dry" = yes ] && ! command -v "$python" >/dev/null; then return; fi
  "$python" -c 'import ensurepip, venv' 2>/dev/null && return
  do_it apt-get install -y --no-install-recommends "$("$python" -c \
    'import sys; print(f"python3.{sys.version_info[1]}-venv")')"
}

ensure_user() {
  if id agribot >/dev/null 2>&1; then
    local group
    for group in dialout video input; do
      id -nG agribot | tr ' ' '\n' | grep -qx "$group" || do_it usermod -aG "$group" agribot
    done
  else
    do_it useradd --system --user-group --home-dir /var/lib/agribot --shell /usr/sbin/nologin \
      --groups dialout,video,input agribot
  fi
}

# Without compiled copies of files that a robot never loads, and without setuptools, which Python
# 3.11 puts beside pip, it takes a fifth less room.
ensure_package() {
  local venv="$root/opt/agribot" target="$from"
  local -a limits=()
  [ -e "$target" ] || stop "--from $target: no such folder or wheel"
  [ -f "$from/constraints.txt" ] && limits=(--constraint "$from/constraints.txt")
  [ -x "$venv/bin/python" ] || do_it "$python" -m venv "$venv"
  do_it "$venv/bin/python" -m pip install --quiet --no-compile "${limits[@]}" "${target}[${extras}]"
  if "$venv/bin/python" -c 'import setuptools' 2>/dev/null; then
    do_it "$venv/bin/python" -m pip uninstall --quiet --yes setuptools
  fi
}

# Put a file in its place if it differs; the status says whether it did.
put() {
  local source="$1" target="$root$2"
  cmp -s "$source" "$target" && return 1
  do_it install -D -m "$3" "$source" "$target"
}

ensure_files() {
  if [ ! -e "$root/etc/agribot/agribot.env" ]; then
    put "$here/agribot.env" /etc/agribot/agribot.env 644 || true
  fi
  if put "$here/70-agribot.rules" /etc/udev/rules.d/70-agribot.rules 644; then
    do_it udevadm control --reload
    do_it udevadm trigger --subsystem-match=tty
  fi
  if put "$here/agribot.service" /etc/systemd/system/agribot.service 644; then
    do_it systemctl daemon-reload
    do_it systemctl enable agribot.service
  fi
}

warn_of_brltty() {
  if [ -e "$root/usr/bin/brltty" ] || [ -e "$root/bin/brltty" ]; then
    say "note: brltty takes CH340 boards for braille displays; if yours does not appear: apt-get remove brltty"
  fi
}

check_machine
name_machine
find_python
ensure_venv_module
ensure_user
ensure_package
ensure_files
warn_of_brltty
say "Done. Name your devices in /etc/agribot/agribot.env, put the robot on blocks, then:
  sudo -u agribot /opt/agribot/bin/agribot doctor
  sudo systemctl start agribot && journalctl -fu agribot"
