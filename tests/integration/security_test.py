#!/usr/bin/env python3
"""security_test.py PROGRAMS BUS_PEER CYCLONE_PEER WALL_CLOCK: the demo rig in a secured domain on loopback.

Everybody who has the right identity is heard, with Fast DDS and Cyclone DDS. A stranger, an identity of another
authority, an expired one and one of the wrong role are refused, and a log says so.
"""
import contextlib
import datetime
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from checks import check, failures, own_domain, read

PROGRAMS, BUS_PEER, CYCLONE_PEER, WALL_CLOCK = sys.argv[1:5]
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DOMAIN, _reservation = own_domain()
VENDORS = ("fast", "cyclone")
missed = []  # what failed and can be a pair of processes that Fast DDS missed (docs/security.md)


def check_paired(condition, what):
    """A check that also fails if Fast DDS missed a pair of processes."""
    if not check(condition, what):
        missed.append(what)


def with_wall_clock(days):
    """The environment of a program whose wall clock is wrong by so many days."""
    return dict(os.environ, LD_PRELOAD=WALL_CLOCK, WALL_CLOCK_SHIFT=str(round(days * 86400)))


def edit(path, old, new):
    text = read(path)
    assert old in text, f"{path} has no {old}"
    with open(path, "w") as out:
        out.write(text.replace(old, new))


class Domain:
    """Folders of identities, and programs that use them."""

    def __init__(self, folder):
        self.folder = folder
        self.make("good")
        self.make("other")
        for copy in ("expired", "lax"):
            shutil.copytree(self.path("good"), self.path(copy))
            self.write_network(copy)
        self.expire()
        # Lets a program write what it likes, as far as its own library checks it.
        edit(self.path("lax/governance.xml"), "<enable_write_access_control>true", "<enable_write_access_control>false")
        self.sign("lax/governance.xml", "lax/governance.p7s")

    def path(self, name):
        return os.path.join(self.folder, name)

    def write_network(self, name):
        with open(self.path(name + ".toml"), "w") as out:
            out.write(f'[network]\nsecurity = "{name}"\n')

    def make(self, name):
        """The identities begin three days ago, so that one that has expired was valid before."""
        subprocess.run([f"{ROOT}/deploy/security", self.path(name)], check=True, env=with_wall_clock(-3))
        self.write_network(name)

    def sign(self, text, out):
        subprocess.run(["openssl", "smime", "-sign", "-text", "-in", self.path(text), "-out", self.path(out),
                        "-signer", self.path("good/authority.pem"), "-inkey", self.path("good/authority.key")],
                       check=True, capture_output=True)

    def expire(self):
        """Signs the requests of clients again, for a time that is over."""
        past = [(datetime.datetime.now(datetime.timezone.utc) - datetime.timedelta(days=days)).strftime("%Y%m%d%H%M%SZ")
                for days in (2, 1)]
        with open(self.path("ca.cnf"), "w") as out:
            out.write("[ca]\ndefault_ca=a\n[a]\ndatabase=index.txt\nserial=serial\nnew_certs_dir=.\ndefault_md=sha256\n"
                      "policy=p\nunique_subject=no\n[p]\ncommonName=supplied\n")
        open(self.path("index.txt"), "w").close()
        with open(self.path("serial"), "w") as out:
            out.write("01\n")
        for role in ("client", "client-cyclone"):
            own = self.path(f"expired/{role}")
            commands = [["openssl", "x509", "-x509toreq", "-in", f"{own}/certificate.pem", "-signkey", f"{own}/key.pem",
                         "-out", f"{own}/request.pem"],
                        ["openssl", "ca", "-batch", "-config", "ca.cnf", "-in", f"{own}/request.pem", "-cert",
                         "good/authority.pem", "-keyfile", "good/authority.key", "-startdate", past[0], "-enddate",
                         past[1], "-notext", "-out", f"{own}/certificate.pem"]]
            for command in commands:
                subprocess.run(command, check=True, capture_output=True, cwd=self.folder)

    def environment(self, name):
        return dict(os.environ, SOFTHAND_DOMAIN=DOMAIN, SOFTHAND_NETWORK=self.path(name + ".toml") if name else "")

    def peer(self, vendor, name, role, does, topic, seconds=3, days=0):
        """Starts a program of a vendor with the identity `role` of the folder `name`; without one if it is empty. Its
        wall clock is wrong by so many days."""
        environment = with_wall_clock(days) | self.environment(name)
        command = [BUS_PEER, role, does, topic, str(seconds)]
        if vendor == "cyclone":
            settings = self.path(f"{vendor}-{name}-{role}.xml")
            with open(settings, "w") as out:
                subprocess.run([f"{PROGRAMS}/softhand", "cyclone", "--role", role], env=environment, stdout=out,
                               check=True)
            environment["CYCLONEDDS_URI"] = "file://" + settings
            command = [CYCLONE_PEER, DOMAIN, does, topic, str(seconds)]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def status(self, name="good"):
        out = subprocess.run([f"{PROGRAMS}/softhand", "status", "--json"], env=self.environment(name),
                             capture_output=True, text=True).stdout
        return json.loads(out) if out.strip().startswith("{") else {}


def number(output, word):
    """The number behind a word in the output of a peer; -1 if the peer was refused."""
    for line in output.splitlines():
        if line.startswith(word + " "):
            return int(line.split()[1])
    return -1


@contextlib.contextmanager
def running(rig, log):
    """Waits until the rig is up, and ends it at the end."""
    try:
        given_up = time.monotonic() + 40
        while "is up" not in read(log) and time.monotonic() < given_up:
            time.sleep(0.1)
        yield
    finally:
        if rig.poll() is None:
            rig.send_signal(signal.SIGTERM)
        rig.wait()
        if failures:
            print(read(log))


def run():
    with tempfile.TemporaryDirectory() as folder:
        domain = Domain(folder)
        summary, log = domain.path("summary.json"), domain.path("rig.log")
        command = [f"{PROGRAMS}/softhand", "up", f"{ROOT}/config/rigs/demo.toml", "--set",
                   "hand.model=right_400.hand.json", "--set", "viewer.port=0"]
        with open(log, "w") as out:
            rig = subprocess.Popen([*command, "--json", summary], env=domain.environment("good"), stdout=out,
                                   stderr=subprocess.STDOUT)
        with running(rig, log):
            run_checks(domain, rig, log, summary)
        with open(log, "w") as out:
            rig = subprocess.Popen(command, env=domain.environment("good"), stdout=out, stderr=subprocess.STDOUT)
        with running(rig, log):
            check_rotation(domain)


def main():
    """Fast DDS 2.9 misses a pair of processes in about one of ten starts (docs/security.md). If nothing else failed,
    the rig is started again, twice at most. A check of who is refused is never repeated."""
    for _ in range(3):
        failures.clear()
        missed.clear()
        run()
        if failures != missed or not failures:
            break
        print("missed a pair: " + "; ".join(missed), flush=True)
    print("FAILED: " + "; ".join(failures) if failures else "passed")
    sys.exit(1 if failures else 0)


def status_of(domain, modules):
    """What `softhand status` hears. An occasional handshake fails (docs/security.md): then it is asked again."""
    heard = {}
    for _ in range(4):
        heard.update(domain.status())
        if modules <= set(heard):
            break
    return heard


def second_writers(domain):
    return status_of(domain, {"haptic"})["haptic"]["counters"]["second_writer"]


def check_gloves(domain):
    """Both gloves have input. One that missed the keys of its writer gets them after a restart (docs/security.md)."""
    for device in ("haptic", "tactile"):
        for _ in range(3):
            status = status_of(domain, {device})[device]
            accepted = status["counters"]["accepted"]
            if accepted > 50:
                break
            print(f"        the {device} glove missed keys and is restarted")
            os.kill(status["process_id"], signal.SIGTERM)
            time.sleep(3)
        check_paired(accepted > 50, f"the {device} glove has {accepted:.0f} samples")


def check_rotation(domain):
    """A renewed certificate is used after a restart of its process. The other processes go on and accept it."""
    folder = domain.path("good")
    first = tracker = status_of(domain, {"tracker"})["tracker"]["process_id"]
    before = read(f"{folder}/tracker/certificate.pem"), read(f"{folder}/hand/certificate.pem")
    made = subprocess.run([f"{ROOT}/deploy/security", folder, "tracker"], capture_output=True, text=True).stdout
    check("made 2 identities" in made, made.strip())
    check(read(f"{folder}/tracker/certificate.pem") != before[0], "the tracker has a new certificate")
    check(read(f"{folder}/hand/certificate.pem") == before[1], "the hand keeps its certificate")
    age = -1
    for _ in range(3):  # a tracker that missed the keys of a reader gets them after a restart (docs/security.md)
        os.kill(tracker, signal.SIGTERM)
        given_up = time.monotonic() + 10
        while time.monotonic() < given_up and not 0 <= age < 500:
            heard = status_of(domain, {"tracker", "tracking"})
            if heard.get("tracker", {}).get("process_id", tracker) != tracker:
                age = heard.get("tracking", {}).get("input_age_ms", -1)
        restarted = heard.get("tracker", {}).get("process_id", tracker)
        if 0 <= age < 500 or restarted == tracker:
            break
        print(f"        the tracker missed keys and is restarted, input {age:.0f} ms old")
        tracker = restarted
    check(restarted != first, "the tracker was restarted")
    check_paired(0 <= age < 500, f"tracking has samples of the new tracker, {age:.0f} ms old")


def run_checks(domain, rig, log, summary):
    def refusals():
        return read(log).count("a process without a valid identity was refused")

    started = time.monotonic()
    check(refusals() == 0, "nobody with an identity is refused")
    check_gloves(domain)

    for vendor in VENDORS:
        for _ in range(3):  # an occasional handshake fails
            output = domain.peer(vendor, "good", "client", "read", "simulated_skeleton").communicate()[0]
            if number(output, "samples") > 50:
                break
        check_paired(number(output, "samples") > 50, f"a client on {vendor} reads {number(output, 'samples')} samples")

    for name, what in (("", "without an identity"), ("other", "of another authority")):
        for vendor in VENDORS:
            before = refusals()
            output = domain.peer(vendor, name, "client", "read", "simulated_skeleton").communicate()[0]
            check(number(output, "samples") == 0, f"a stranger {what} on {vendor} reads nothing")
            check(refusals() > before, f"it is logged by {refusals() - before} processes of the rig")
            output = domain.peer(vendor, name, "hand", "write", "bone_wrench").communicate()[0]
            check(number(output, "readers") == 0, "it finds no reader of a wrench that it writes")
    check(second_writers(domain) == 0, "no glove receives a wrench of a stranger")

    for vendor, words in (("fast", "cannot join domain"), ("cyclone", "cannot join the domain")):
        output = domain.peer(vendor, "expired", "client", "read", "simulated_skeleton").communicate()[0]
        check(number(output, "samples") <= 0 and words in output, f"an expired identity on {vendor}: {words}")
        print("        " + "\n        ".join(line[:160] for line in output.splitlines() if "expired" in line.lower()))
        # Its own library accepts it if its clock is late. The rig does not.
        before = refusals()
        output = domain.peer(vendor, "expired", "client", "read", "simulated_skeleton", days=-1.5).communicate()[0]
        check(number(output, "samples") == 0, f"an expired identity on {vendor} with a late clock reads nothing")
        check(refusals() > before, f"it is logged by {refusals() - before} processes of the rig")

    for vendor, words in (("fast", "cannot create a writer of softhand/v1/bone_wrench"),
                          ("cyclone", "cannot write softhand/v1/bone_wrench")):
        output = domain.peer(vendor, "good", "tracker", "write", "bone_wrench", 1).communicate()[0]
        check(number(output, "readers") < 0 and words in output, f"a tracker on {vendor}: {words}")

    # The rig checks it, too, if the tracker's own library does not.
    for vendor in VENDORS:
        before = read(log).count("Security manager returns an error")
        output = domain.peer(vendor, "lax", "tracker", "write", "bone_wrench").communicate()[0]
        check_paired(number(output, "readers") >= 0, f"a tracker without own checks on {vendor} writes wrenches")
        check(second_writers(domain) == 0, "no glove receives them")
        check(read(log).count("Security manager returns an error") > before, "the rig logs it")
    for _ in range(3):  # an occasional handshake fails
        domain.peer("fast", "good", "hand", "write", "bone_wrench", 4).communicate()
        if second_writers(domain) > 0:
            break
    check_paired(second_writers(domain) > 0, "a glove receives those of a second hand, and counts them")

    modules = {"world", "hand", "tracking", "haptic", "tactile", "tracker"}
    heard = status_of(domain, modules)
    check_paired(modules <= set(heard), "status hears every module")
    time.sleep(max(0, started + 15 - time.monotonic()))
    rig.send_signal(signal.SIGINT)
    check(rig.wait() == 0, "the rig ends cleanly")
    weight = json.loads(read(summary))["carried_weight_ratio"]
    check_paired(weight is not None and 0.98 <= weight <= 1.02, f"weight of the cube: {weight}")


main()
