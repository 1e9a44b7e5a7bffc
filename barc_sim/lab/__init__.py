"""Teaching: a user's own code, its templates, checking, grading and reports.

It runs without ROS; a user's model and controller reach a node as values.

The way of a submission to its points, in the order of reading:

======================  ======================================================================
file                    what it does
======================  ======================================================================
`commands/grade.py`     grades one submission or a class; `commands/check.py` is for a student
`submission.py`         reads the files of a folder or a zip, within limits
`files.py`              lists each lab's files and functions, and finds a lab's files by name
`grade/rubrics/`        the points of each criterion, a YAML file for each lab
`grade/grade.py`        reads the rubric; turns scores into points, and points into a report
`judge.py`              turns the results of user code into scores and messages
`labs/`                 each lab: what is tried, and how its drives are judged
`law.py`, `labs/*.txt`  the right formulas and the common mistakes
`confined/process.py`   starts the confined process of a submission, and sends its requests
`confined/child.py`     the script of that process: it confines itself, then answers requests
`confined/replies.py`   checks the replies
`user_code/`            loads and calls a user's files, confined or not
`grade/classroom.py`    the grades of a class
`pages/`                the templates of the HTML pages: of a grade, of a class, and of a run
======================  ======================================================================

Apart from these, `submit.py` packs what a student hands in, `own_estimate.py` is what `identify.py`
of Lab 5 calls, and `run_report.py` writes the page of `barc report`, about a run.
`commands/lab.py` has the commands `new`, `report` and `submit`.

Words that could mean several things, and what they mean in this room:

==========  =======================================================================================
word        meaning
==========  =======================================================================================
report      what a person reads about a grade: `results.json` and `report.html`; a report about a
            run is always called a run's report
folder      a directory with a user's files; the class `Folder` imports its modules, and
            `ClassEntry.folder` is the name of the folder of a student's report
process     a process of the operating system; in `grade` there are three kinds: the command
            itself, its workers, and one for each submission, which alone runs the user's code
confined    of a process: the kernel refuses files, network and other processes
judged      of code: called by the judge, in the process of a submission, confined or not
==========  =======================================================================================

The word lab stands for an exercise. In code, a `Handout` is what a student gets, and a `Lab` is how
it is judged; `barc new --lab` takes the key of a handout, the other commands take the folder with a
user's files as `--lab` or LAB. One lab has several names, which users type:

================  ====================  ==========  =======================
`barc new --lab`  module and templates  rubric      what a student writes
================  ====================  ==========  =======================
`hills`           `hills`               `lab`       a model, a PID, a relay
`3`               `lane`                `lane`      errors, a class `Lane`
`4`               `raceline`            `raceline`  speeds, a line, an MPC
`5`               `identify`            `identify`  commands, an estimate
================  ====================  ==========  =======================

The two records of a lab have one name: `files.HILLS` is the handout of the hills,
`labs.hills.HILLS` its `Lab`, and so for the other labs. The rubric `lab` is the one of the hills,
and so are "the lab's road" and "the lab's car".
"""
