import os
import re
import signal
import subprocess
import sys
import time

import pytest

from impactscope.analysis import analyse
from impactscope.cli.printing import EXIT
from impactscope.recordings import open_recording
from impactscope.records import Verdict

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_interrupted_it_flushes_and_judges_what_there_was(tmp_path):
    target, report = tmp_path / 'live.mcap', tmp_path / 'live.html'
    command = [sys.executable, '-m', 'impactscope', 'live', '--simulated', 'hand_pass']
    command += ['--record-to', str(target), '--report', str(report)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        deadline = time.monotonic() + 90
        while time.monotonic() < deadline:
            line = process.stdout.readline()
            if line.startswith('blow 1'):
                break
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert 'Traceback' not in err
    told = re.search(r'live\.mcap: (\d+) blow', out)
    assert told is not None, out
    assert 'PASS' in report.read_text(encoding='utf-8')
    with open_recording(target) as recording:
        assert recording.info.damage == ()
        counts = {topic.name: topic.count for topic in recording.info.topics}
    # The bench goes on until the signal is there, which may be after another blow; whatever was
    # acquired by then is judged, no more and no less.
    result = analyse(target)
    blows = result.events
    assert process.returncode == EXIT[result.verdict], out
    # Only a blow that the signal cut off may be anything but passed, and it is no failure.
    verdicts = [blow.verdict.verdict for blow in blows]
    assert {*verdicts[:1], *verdicts[:-1]} == {Verdict.PASS}, out
    assert verdicts[-1] in {Verdict.PASS, Verdict.INVALID}, out
    assert counts['/bench/events'] == int(told[1]) == len(blows) >= 1
    assert counts['/bench/verdict'] >= 2  # the blow, and the test point closed by the end
