"""Every public class behaves as OpenTURNS' own: names, text, equality, copies, pickles, studies. One suite for all."""

import copy
import html.parser
import pickle

import openturns as ot
import pytest
from public_objects import CASES, EXCEPTIONS_AND_FUNCTIONS, OBJECTS, make

import satsep_ot
from satsep_ot.openturns_object import OpenTURNSObject


def test_every_public_class_is_in_the_list():
    assert set(OBJECTS) | EXCEPTIONS_AND_FUNCTIONS >= set(satsep_ot.__all__) - {"__version__"}


@pytest.mark.parametrize(("name", "state"), CASES)
class TestEveryPublicClass:
    def test_class_name_and_name(self, name, state):
        thing = make(name, state)
        assert isinstance(thing, OpenTURNSObject)
        assert thing.getClassName() == name
        assert thing.getName() == "Unnamed"
        thing.setName("mine")
        assert thing.getName() == "mine"
        assert str(thing).splitlines()[0] == f'{name} "mine"'

    def test_text_on_one_line_and_on_several(self, name, state):
        thing = make(name, state)
        assert repr(thing).startswith(f"{name}(")
        assert "\n" not in repr(thing)
        shown = thing._shown()
        assert shown
        assert str(thing).splitlines()[: 1 + len(shown)] == [name, *(f"  {key}: {shown[key]}" for key in shown)]

    def test_notebook_table(self, name, state):
        thing = make(name, state)
        cells, tags = [], []

        class Reader(html.parser.HTMLParser):
            def handle_starttag(self, tag, attributes):
                tags.append(tag)

            def handle_endtag(self, tag):
                assert tags.pop() == tag

            def handle_data(self, data):
                cells.append(data)

        Reader(convert_charrefs=True).feed(thing._repr_html_())
        assert not tags
        text = "".join(cells)
        assert all(key in text and str(value) in text for key, value in thing._shown().items())

    def test_equal_to_its_copies_and_to_nothing_else(self, name, state):
        thing = make(name, state)
        for other in (copy.copy(thing), copy.deepcopy(thing)):
            assert other == thing
        assert thing != "something else"
        other = copy.copy(thing)
        other.setName("another")
        assert other != thing

    def test_pickle(self, name, state):
        thing = make(name, state)
        again = pickle.loads(pickle.dumps(thing))
        assert again == thing
        assert repr(again) == repr(thing)

    def test_study(self, name, state, tmp_path):
        thing = make(name, state)
        thing.setName("kept")
        study = ot.Study(str(tmp_path / "study.xml"))
        satsep_ot.addToStudy(study, "thing", thing)
        study.save()
        read = ot.Study(str(tmp_path / "study.xml"))
        read.load()
        again = satsep_ot.readFromStudy(read, "thing")
        assert again == thing
        assert again.getName() == "kept"


def test_different_states_differ():
    assert make("ActiveSubspaceAlgorithm", "new") != make("ActiveSubspaceAlgorithm", "done")
    changed = make("RidgeApproximation", "new")
    changed.setDegree(2)
    assert changed != make("RidgeApproximation", "new")
    other = make("ActiveSubspaceAlgorithm", "new")
    other.setSamplingSize(21)
    assert other != make("ActiveSubspaceAlgorithm", "new")
    ot.RandomGenerator.SetSeed(6)
    assert OBJECTS["ActiveSubspaceResult"]["new"]() != make("ActiveSubspaceResult", "new")


def test_what_was_asked_before_does_not_count():
    asked, other = make("ActiveSubspaceResult", "new"), make("ActiveSubspaceResult", "new")
    asked.getRegressionResult().getMetaModel()
    assert asked == other


def test_the_repeated_run_of_what_was_read_is_the_same(tmp_path):
    study = ot.Study(str(tmp_path / "study.xml"))
    satsep_ot.addToStudy(study, "search", make("ActiveSubspaceAlgorithm", "of a Python model"))
    study.save()
    study = ot.Study(str(tmp_path / "study.xml"))
    study.load()
    eigenvalues = []
    for search in (satsep_ot.readFromStudy(study, "search"), make("ActiveSubspaceAlgorithm", "of a Python model")):
        ot.RandomGenerator.SetSeed(1)
        search.run()
        eigenvalues.append(search.getResult().getEigenvalues())
    assert eigenvalues[0] == eigenvalues[1]


def test_what_cannot_be_stored_is_refused_in_a_sentence(tmp_path):
    study = ot.Study(str(tmp_path / "study.xml"))
    with pytest.raises(TypeError, match="'law' is a Normal; give an object of satsep_ot"):
        satsep_ot.addToStudy(study, "law", ot.Normal())
    stream = make("MonteCarloStream", "new")
    stream.setProgressCallback(lambda share: None)
    with pytest.raises(TypeError, match=r"'stream' cannot be stored: .* not lambdas"):
        satsep_ot.addToStudy(study, "stream", stream)
    study.add("law", ot.Normal())
    study.add("words", ot.Description(["a", "b", "c"]))
    for label in ("law", "words", "nothing"):
        with pytest.raises(ValueError, match=f"no object of satsep_ot under '{label}'"):
            satsep_ot.readFromStudy(study, label)
