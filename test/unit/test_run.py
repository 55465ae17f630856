"""The entry for people, as far as nothing has to be set up for it."""

import os
import re
import subprocess
from pathlib import Path

RUN = Path(__file__).resolve().parents[2] / 'run'


def run(*arguments, **environment):
    return subprocess.run(['bash', str(RUN), *arguments], env={**os.environ, **environment}, capture_output=True,
                          text=True, timeout=60, check=False)


def test_help_lists_every_command():
    commands = re.findall(r'^  (\w+)(?: \|[^)]*)?\)$', RUN.read_text(), re.MULTILINE)
    assert {'demo', 'check', 'test', 'bench', 'compare', 'exec', 'help'} <= set(commands)
    result = run('help')
    assert result.returncode == 0
    assert set(commands) <= set(re.findall(r'^\./run (\w+)', result.stdout, re.MULTILINE))


def test_unknown_commands_are_refused():
    result = run('fly')
    assert (result.returncode, result.stderr.splitlines()[-1]) == (1, "run: there is no 'fly'")


def test_a_home_that_cmake_can_not_work_in_is_refused_before_anything_is_done(tmp_path):
    for name in ('with space', "with'quote", 'with:colon'):
        result = run('exec', 'true', RVC_FEATURES_HOME=str(tmp_path / name))
        assert (result.returncode, result.stderr.count('\n')) == (1, 1)
        assert f"can't work in '{tmp_path / name}'; set RVC_FEATURES_HOME" in result.stderr
        assert not (tmp_path / name).exists()


def test_a_home_that_can_not_be_written_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    result = run('exec', 'true', RVC_FEATURES_HOME=str(tmp_path / 'file'))
    assert (result.returncode, result.stderr.count('\n')) == (1, 1)
    assert f"can't write to {tmp_path / 'file'}" in result.stderr


def test_a_folder_that_a_program_still_writes_into_does_not_hinder_its_removal(tmp_path):
    function = re.search(r'^discard\(\) \{.*?^\}', RUN.read_text(), re.MULTILINE | re.DOTALL)[0]
    (tmp_path / 'devel').mkdir()
    writer = subprocess.Popen(['bash', '-c', 'cd devel; while :; do mkdir -p a/b; : >a/b/$((++n)); done 2>/dev/null'],
                              cwd=tmp_path)
    try:
        for _ in range(5):
            (tmp_path / 'devel').mkdir(exist_ok=True)
            done = subprocess.run(['bash', '-ec', f'home=$PWD\n{function}\ndiscard "$home/devel" "$home/not there"'],
                                  cwd=tmp_path, stderr=subprocess.PIPE, timeout=60, check=False)
            assert (done.returncode, done.stderr) == (0, b'')
            assert not (tmp_path / 'devel').exists()
    finally:
        writer.kill()
        writer.wait()
