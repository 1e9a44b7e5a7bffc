"""The commands of `barc`, listed here; the other packages do their work.

A command is a module of its name with two functions: `add_arguments(parser)` describes the command
and its options, and `run(options)` returns the exit code (None: 0) and raises UserError. Where
commands share a module, the functions have the command's name behind theirs, as in `run_acc`.
"""

#: By group, in the order of `barc --help`: the commands, and what each does.
GROUPS = {
    'drive': {
        'acc': 'drive with the cruise control over the hills',
        'teleop': 'drive by hand',
    },
    'look': {
        'plot': 'draw speed, grade and command of a run',
        'replay': 'play a run on a web page, or save a video',
        'raceline': 'find the racing line of a track, and its lap time',
        'identify': 'estimate drag, friction, delay and tyres of the car that made a bag',
    },
    'lab': {
        'new': 'make a folder with templates: model, controller, relay and compose.py',
        'check': 'find mistakes in model, controller, relay and compose.py, and their causes',
        'tune': 'search for the gains that hold the speed best',
        'report': 'write a run as one HTML page to hand in',
        'submit': 'pack code, bags, figures and a description as one zip',
        'grade': 'grade one submission or a class',
    },
    'bags': {
        'record': 'record any ROS 2 system',
        'play': 'publish the messages of a bag',
        'info': 'print what is in a bag: time, topics, losses, damage and metadata',
        'convert': 'write the topics of a bag as CSV files',
        'recover': 'copy the bag of a killed run into a complete one',
    },
    'ROS': {
        'topics': 'list topics, their types, publishers and subscribers',
        'echo': 'print the messages of a topic',
        'param': 'list, read and set the parameters of running nodes',
        'show': 'print the definition of a message, service or action',
        'graph': 'draw nodes and topics, running or in a bag',
        'node': 'run one node alone in this process',
    },
}
COMMANDS = {name: text for group in GROUPS.values() for name, text in group.items()}
#: The module of each command that shares one with others; `__main__.functions` imports it.
SHARED = dict.fromkeys(GROUPS['drive'], 'drive')
SHARED |= dict.fromkeys(('plot', 'replay'), 'figures')
SHARED |= dict.fromkeys(('new', 'report', 'submit'), 'lab')
SHARED |= dict.fromkeys(('tune', 'identify', 'raceline'), 'research')
SHARED |= dict.fromkeys(GROUPS['bags'], 'bags')
SHARED |= dict.fromkeys(GROUPS['ROS'], 'introspection')
